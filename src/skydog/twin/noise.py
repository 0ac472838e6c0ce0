"""What is drawn for a mission: the disturbances of a step, from a generator of its own."""

from collections import deque
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Key

from skydog.flight.profiles import UAV
from skydog.flight.station import DT, Commands, Frame
from skydog.twin.disturbances import DRIFT_LASTS, GUST_LASTS, Disturbances
from skydog.twin.plant import Truth


class Drawn(NamedTuple):
    """What is random in one tick of the base station, of a batch of missions."""

    dogs: Float[np.ndarray, "batch dogs 3"]  # standard normal
    sheep: Float[np.ndarray, "batch sheep 3"]
    gust: Float[np.ndarray, "batch dogs 2"]
    # Uniform from 0 to 1: of being seen, of being heard.
    chance: Float[np.ndarray, "batch bodies 2"]
    shaken: Float[np.ndarray, "batch dogs 3"]  # uniform from -1 to 1


class Luck:
    """The disturbances of a batch of missions.

    Each mission draws from a generator of its own, so that it is the same in any company.
    """

    def __init__(
        self,
        disturb: Disturbances,
        uav: UAV,
        keys: Key[Array, " batch"],
        sheep: int,
        dogs: int,
    ):
        self.disturb, self.link = disturb, uav.link
        # Nothing is random but where the rovers look at the start.
        self.is_calm = disturb == Disturbances(
            observation_delay=disturb.observation_delay,
            action_delay=disturb.action_delay,
            friction=disturb.friction,
        )
        self._sheep, self._dogs = sheep, dogs
        seeds = np.asarray(jax.random.key_data(keys))
        self._draws = [np.random.default_rng(np.ravel(seed)) for seed in seeds]
        angle = self._uniform(dogs)
        size = disturb.own_errors * uav.link.trim
        self.trim = size * np.stack([np.cos(np.pi * angle), np.sin(np.pi * angle)], axis=-1)
        self.yaw = np.pi * self._uniform(sheep)
        self._drift, self._slip = self._anew()
        self._gust = disturb.gust * self._normal(dogs, 2)
        self._frames: deque[Truth] = deque(maxlen=1 + _ticks(disturb.observation_delay))
        self._commands: deque[Commands] = deque(
            maxlen=1 + _ticks(disturb.action_delay + uav.link.delay)
        )
        self._heard: Commands | None = None
        self._age = 0

    def draw(self, ticks: int) -> list[Drawn | None]:
        """What is random in the next so many ticks."""
        if self.is_calm:
            return [None] * ticks
        dogs, sheep = self._dogs, self._sheep
        sizes = (3 * dogs, 3 * sheep, 2 * dogs)
        normal = np.stack(
            [rng.standard_normal((ticks, sum(sizes)), np.float32) for rng in self._draws], 1
        )
        uniform = np.stack(
            [rng.random((ticks, 2 * (dogs + sheep) + 3 * dogs), np.float32) for rng in self._draws],
            1,
        )
        of_dogs, of_sheep, gust = np.split(normal, np.cumsum(sizes)[:-1], axis=-1)
        chance, shaken = np.split(uniform, [2 * (dogs + sheep)], axis=-1)
        missions = len(self._draws)
        return [
            Drawn(
                of_dogs[tick].reshape(missions, dogs, 3),
                of_sheep[tick].reshape(missions, sheep, 3),
                gust[tick].reshape(missions, dogs, 2),
                chance[tick].reshape(missions, dogs + sheep, 2),
                2.0 * shaken[tick].reshape(missions, dogs, 3) - 1.0,
            )
            for tick in range(ticks)
        ]

    def frame(self, truth: Truth, drawn: Drawn | None) -> Frame:
        """What motion capture sees: late, noisy, and not always."""
        self._frames.append(truth)
        late = self._frames[0]
        if drawn is None:
            seen = np.ones(late.dogs.shape[:2], bool), np.ones(late.yaw.shape, bool)
            return Frame(late.dogs, late.sheep, late.yaw, *seen)
        disturb = self.disturb
        seen = drawn.chance[..., 0] >= disturb.dropout
        return Frame(
            late.dogs + disturb.mocap_noise * drawn.dogs,
            late.sheep + disturb.mocap_noise * drawn.sheep[..., :2],
            late.yaw + disturb.yaw_noise * drawn.sheep[..., 2],
            seen[:, : self._dogs],
            seen[:, self._dogs :],
        )

    def hear(self, sent: Commands, drawn: Drawn | None) -> Commands:
        """What the robots hear of what is sent: late, and not always."""
        self._commands.append(sent)
        late = self._commands[0]
        if drawn is None or self._heard is None:
            self._heard = late
            return late
        heard, before = drawn.chance[..., 1] >= self.disturb.command_loss, self._heard
        dogs, sheep = heard[:, : self._dogs], heard[:, self._dogs :]
        kept = Commands(
            np.where(dogs[..., None], late.velocity, before.velocity),
            np.where(dogs[..., None], late.tilt, before.tilt),
            type(late.twist)(
                np.where(sheep, late.twist.speed, before.twist.speed),
                np.where(sheep, late.twist.turn_rate, before.twist.turn_rate),
            ),
        )
        self._heard = kept
        return kept

    def shake(
        self, command: Float[np.ndarray, "batch dogs axes"], drawn: Drawn | None
    ) -> Float[np.ndarray, "batch dogs axes"]:
        """A command, of velocity or of tilt, with the errors of the drone's own profile."""
        if drawn is None:
            return command
        axes, share = command.shape[-1], self.disturb.own_errors
        error = self.link.noise * drawn.shaken[..., :axes] + self._drift[..., :axes]
        return command + share * error

    def wind(self, drawn: Drawn | None) -> Float[np.ndarray, "batch dogs 2"] | None:
        """The acceleration by gusts in m/s², a tick after the one before."""
        if drawn is None or not self.disturb.gust:
            return None
        kept = np.exp(-DT / GUST_LASTS)
        fresh = self.disturb.gust * np.sqrt(1.0 - kept**2)
        self._gust = kept * self._gust + fresh * drawn.gust
        return self._gust

    def grip(self) -> Float[np.ndarray, "2 batch sheep"]:
        """Which share of its speed each left and each right wheel brings to the floor."""
        self._age += 1
        if not self.is_calm and self._age % _ticks(DRIFT_LASTS) == 0:
            self._drift, self._slip = self._anew()
        return 1.0 - self._slip

    def _anew(self) -> tuple[np.ndarray, np.ndarray]:
        drift = self.link.drift * self._uniform(self._dogs, 3)
        slip = self.disturb.slip * np.abs(self._normal(2, self._sheep))
        return drift, np.clip(np.moveaxis(slip, 1, 0), 0.0, 0.5)

    def _normal(self, *shape: int) -> np.ndarray:
        return np.stack([rng.standard_normal(shape) for rng in self._draws])

    def _uniform(self, *shape: int) -> np.ndarray:
        return np.stack([rng.uniform(-1.0, 1.0, shape) for rng in self._draws])


def _ticks(seconds: float) -> int:
    return round(seconds / DT)
