"""Starts that can be flown: rovers that do not overlap, and a clear pad for every drone.

Of random starts rovers overlap in one of seven, and a drone would take off beside a rover in one
of fourteen: those are drawn anew.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from skydog import numerics
from skydog.errors import Refusal
from skydog.flight.limits import APART, PAD, Corner
from skydog.flight.profiles import UAV, Rover
from skydog.study import cases
from skydog.study.options import FlyableStarts
from skydog.twin.bodies import closed_to
from skydog.world import obstacles
from skydog.world.obstacles import Obstacles
from skydog.world.params import World
from skydog.world.state import State

DRAWS = 1000  # times as many as are asked for, at most


def flyable(
    starts: State, uav: UAV, rover: Rover, sides: Corner, closed: Obstacles | None = None
) -> tuple[Bool[np.ndarray, " cases"], Bool[np.ndarray, " cases"]]:
    """In which starts rovers fit, in the arena and apart, and in which all pads are clear.

    A pad is also clear of the walls and of obstacles. `closed` is what `bodies.closed_to` returns.
    """
    sheep, dogs = (np.asarray(who, float) for who in (starts.sheep, starts.dogs))
    apart = 2 * rover.body.radius + APART
    clear = rover.body.radius + uav.body.radius + PAD
    spaced = _nearest(sheep, sheep) >= apart
    spaced &= np.all((sheep >= 0.0) & (sheep <= sides), axis=(1, 2))
    pads = (_nearest(dogs, sheep) >= clear) & (_nearest(dogs, dogs) >= 2 * uav.body.radius + APART)
    # The walls stand a rover's radius outside the arena.
    inside = max(0.0, uav.body.radius + PAD - rover.body.radius)
    pads &= np.all((dogs >= inside) & (dogs <= sides - inside), axis=(1, 2))
    if closed is not None:
        free = [np.asarray(_clearance(closed, who)) for who in (starts.sheep, starts.dogs)]
        spaced &= free[0] >= 0.0
        pads &= free[1] >= uav.body.radius + PAD - rover.body.radius
    return spaced, pads


def check(
    starts: State, uav: UAV, rover: Rover, sides: Corner, closed: Obstacles | None = None
) -> None:
    """Raise `Refusal` for a start that cannot be flown, as `flyable` tells."""
    spaced, pads = flyable(starts, uav, rover, sides, closed)
    where = "outside the arena" if closed is None else "outside the arena or in an obstacle"
    for fits, what in (
        (spaced, f"rovers overlap or stand {where}"),
        (pads, "a drone's pad is not clear"),
    ):
        if not fits.all():
            raise Refusal(
                f"in start {int(np.argmin(fits))} {what}, which cannot be flown; "
                "draw starts with skydog.twin.starts.draw, or use --starts spaced"
            )


@numerics.ours()
def draw(
    world: World,
    count: int,
    kind: FlyableStarts,
    uav: UAV,
    rover: Rover,
    seed: int = 0,
    sheep: int = 3,
    dogs: int = 1,
) -> State:
    """`count` starts that can be flown: the same for the same arguments. Raises `Refusal`."""
    closed, (wide, high) = closed_to(rover, world.obstacles), world.arena.plain_sides
    sides = wide if wide == high else np.array([wide, high])
    sort = "random" if kind == "spaced" else kind
    found: list[State] = []
    want = count
    for batch in range(DRAWS):
        drawn = cases.cases(world, max(2 * count, 32), sort, seed + 1_000_003 * batch, sheep, dogs)
        spaced, pads = flyable(drawn, uav, rover, sides, closed)
        fits = np.flatnonzero(spaced & pads)[:want]
        found.append(jax.tree.map(lambda leaf, fits=fits: leaf[fits], drawn))
        want -= len(fits)
        if want == 0:
            return jax.tree.map(lambda *parts: jnp.concatenate(parts), *found)
        if batch >= 20 and want == count:
            break
    raise Refusal(
        f"{sheep} rovers of {2 * rover.body.radius:g} m do not find room to start beside "
        f"drones of {2 * uav.body.radius:g} m in an arena of {wide:g} m; "
        "try a larger --arena"
    )


@jax.jit
def _clearance(closed: Obstacles, places: Float[Array, "cases some 2"]) -> Float[Array, " cases"]:
    """How far the one that is nearest to an obstacle is from where rovers' centres cannot be."""
    return jax.vmap(lambda these: jnp.min(obstacles.clearance(closed, these)))(places)


def _nearest(
    some: Float[np.ndarray, "cases some 2"], others: Float[np.ndarray, "cases others 2"]
) -> Float[np.ndarray, " cases"]:
    """The distance in metres between the two nearest of two groups, a body itself left out."""
    away = np.linalg.norm(some[:, :, None] - others[:, None], axis=-1)
    if some is others:
        away = away + np.where(np.eye(some.shape[1], dtype=bool), np.inf, 0.0)
    return away.min(axis=(1, 2))
