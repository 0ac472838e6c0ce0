"""A million random sequences of poses, decisions, orders: none flies blind or beyond limits."""

import numpy as np
import pytest

from skydog.flight import base, profiles
from skydog.flight.base import Base, Decided, Told
from skydog.flight.limits import Limits
from skydog.flight.station import Frame, Station
from skydog.flight.supervisor import EVENTS, Mode, Order

pytestmark = pytest.mark.usefixtures("unchecked")

SEQUENCES, AT_ONCE, TICKS = 1_000_000, 20_000, 12
CAGE, AIRSPACE, ARENA = (-0.7, 6.7), (-0.2, 6.2), (0.0, 6.0)
ROVER = profiles.rover("kobuki")
IN_AIR = (Mode.TAKING_OFF, Mode.MISSION, Mode.HOLD, Mode.LANDING)


class Sequences:
    """Missions side by side, each with everything random, and what holds in every instant."""

    def __init__(self, profile, seed):
        self.rng = np.random.default_rng(seed)
        self.uav = profiles.uav(profile)
        limits = Limits(
            CAGE,
            CAGE,
            (-0.5, 3.0),
            silence=0.15,
            longest_hold=0.2,
            longest_take_off=0.2,
            runs_for=0.02,
        )
        station = Station(self.uav, ROVER, "reference", None, 0.1, np.asarray(0.5), 4.0)
        self.base = Base(station, limits, AIRSPACE, ARENA, np.full((AT_ONCE, 1), 2.0))
        self.at = self.rng.uniform((0.0, 0.0, 0.0), (6.0, 6.0, 2.5), (AT_ONCE, 1, 3))
        self.sheep = self.rng.uniform(0.0, 6.0, (AT_ONCE, 1, 2))
        # Some rovers roll on, whatever they are told.
        self.drift = self.rng.normal(0.0, 0.02, (AT_ONCE, 1, 2))
        self.lost = np.zeros(AT_ONCE, bool)
        self.now = 0.0
        self.memory = base.start(self.base, self.frame(), 0.0)
        # Half of them begin in some mode that sequences so short would hardly come to.
        mode = np.where(self.chance(0.5), 0, self.rng.integers(0, len(Mode), AT_ONCE))
        watched = self.memory.supervisor._replace(mode=mode)
        self.memory = self.memory._replace(supervisor=watched)

    def chance(self, share, *shape):
        return self.rng.random((AT_ONCE, *shape)) < share

    def frame(self):
        """Poses near to where the bodies were, or not at all, or far away, or no numbers."""
        self.at = self.at + self.rng.normal(0.0, 0.005, self.at.shape)
        self.sheep = self.sheep + self.drift + self.rng.normal(0.0, 0.005, self.sheep.shape)
        self.lost = np.where(self.chance(0.2), ~self.lost, self.lost)
        dogs, sheep = self.at.copy(), self.sheep.copy()
        jumps = self.chance(0.05)
        dogs[jumps] += self.rng.normal(0.0, 3.0, (jumps.sum(), 1, 3))
        for broken in (np.nan, np.inf, 1e300):
            dogs[self.chance(0.01)] = broken
            sheep[self.chance(0.01)] = broken
        yaw = self.rng.uniform(-np.pi, np.pi, (AT_ONCE, 1))
        yaw[self.chance(0.01)] = np.nan
        seen = ~self.lost[:, None]
        return Frame(dogs, sheep, yaw, seen & self.chance(0.9, 1), seen & self.chance(0.95, 1))

    def told(self):
        order = np.where(self.chance(0.4), self.rng.integers(0, len(Order), AT_ONCE), 0)
        # Take-off and arming often enough that flights begin.
        order = np.where(self.chance(0.2), self.rng.choice([1, 3], AT_ONCE), order)
        return Told(
            order,
            self.chance(0.9),
            np.where(self.chance(0.98, 1), 1.0, self.rng.random((AT_ONCE, 1))),
            self.chance(0.01),
            self.chance(0.1, 1),
            self.chance(0.5, 1),
            self.chance(0.01),
            self.chance(0.01),
        )

    def decided(self):
        if self.rng.random() < 0.2:
            return None
        dogs, sheep = (self.rng.normal(0.0, 2.0, (AT_ONCE, 1, 2)) for _ in range(2))
        for broken in (np.nan, np.inf, 1e300):
            dogs[self.chance(0.01)] = broken
            sheep[self.chance(0.01)] = broken
        return Decided(dogs, sheep)

    def tick(self):
        dt = float(self.rng.choice([0.01, 0.01, 0.05, 0.09, 0.2]))
        self.now += dt
        before, told = self.memory, self.told()
        self.memory, sent = base.step(
            self.base, before, self.frame(), told, self.decided(), self.now
        )
        self.events = sent.change.event
        self.check(before, told, sent, min(dt, 0.1))

    def check(self, before, told, sent, dt):
        limits, mode = self.base.limits, self.memory.supervisor.mode
        was, oldest = before.supervisor.mode, sent.age.max(axis=1)
        moves = np.isin(mode, (Mode.TAKING_OFF, Mode.MISSION))
        assert np.all(oldest[moves] <= limits.stale), "nothing goes on with stale eyes"
        assert np.all(oldest[mode == Mode.HOLD] <= limits.blind), "nothing holds blind for long"
        took_off = np.isin(mode, IN_AIR) & ~np.isin(was, IN_AIR)
        assert np.all(told.order[took_off] == Order.TAKE_OFF)
        assert np.all(told.ready[took_off])
        cut = (mode == Mode.EMERGENCY) & (was != Mode.EMERGENCY)
        assert np.all(np.isin(told.order[cut], (Order.EMERGENCY, Order.STOP))), "a human alone"
        let_go = (was == Mode.EMERGENCY) & (mode != Mode.EMERGENCY)
        assert np.all(told.order[let_go] == Order.RESET)
        changed = mode != was
        assert np.all((sent.change.event >= 0) == changed), "every transition has its reason"

        velocity, tilt, twist = sent.commands
        for numbers in (velocity, tilt, *twist):
            assert np.isfinite(numbers).all()
        most = self.uav.velocity
        assert np.hypot(velocity[..., 0], velocity[..., 1]).max() <= most.largest + 1e-9
        assert np.abs(velocity[..., 2]).max() <= most.largest_climb + 1e-9
        assert np.abs(tilt).max() <= self.uav.attitude.largest + 1e-9
        still = np.isin(mode, (Mode.DISARMED, Mode.READY, Mode.EMERGENCY))
        assert np.all(velocity[still] == 0.0)
        assert np.all(velocity[sent.hover, :2] == 0.0), "who is not seen is told to hover"
        faster = velocity[..., :2] - before.station.command[..., :2]
        flown = ~sent.hover & (moves | (mode == Mode.HOLD))[:, None]
        assert np.hypot(*faster[flown].T).max(initial=0.0) <= 4.0 * dt + 1e-9

        motion = ROVER.motion
        assert np.abs(twist.speed).max() <= motion.largest_speed + 1e-9
        assert np.abs(twist.turn_rate).max() <= motion.largest_turn_rate + 1e-9
        gained = np.abs(twist.speed - before.station.twist.speed)
        assert gained[mode != Mode.EMERGENCY].max() <= motion.acceleration * dt + 1e-9
        braked = np.abs(twist.speed) <= np.abs(before.station.twist.speed) + 1e-9
        assert np.all(braked[mode != Mode.MISSION]), "rovers drive in a mission alone"

        goal = self.memory.station.dog_setpoint
        end = (goal.origin + 0.1 * goal.velocity)[(mode == Mode.MISSION) & ~changed]
        moved = end[np.any(goal.velocity[(mode == Mode.MISSION) & ~changed] != 0.0, axis=(1, 2))]
        assert np.all((moved >= AIRSPACE[0] - 1e-9) & (moved <= AIRSPACE[1] + 1e-9)), "soft fence"


@pytest.mark.parametrize("profile", ["ardrone2", "crazyflie"])
def test_no_sequence_flies_blind_or_beyond_a_limit(profile):
    seen = set()
    for seed in range(SEQUENCES // AT_ONCE // 2):
        sequences = Sequences(profile, seed)
        for _ in range(TICKS):
            sequences.tick()
            seen |= set(np.unique(sequences.events))
    assert seen == set(range(-1, len(EVENTS))), "all that can happen has happened"
