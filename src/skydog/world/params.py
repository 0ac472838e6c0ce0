"""The world: its parameters, and the laws that it carries, each of which can be exchanged."""

from typing import Any, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from skydog.errors import Refusal, short
from skydog.world.laws import Flock
from skydog.world.limits import AnyDirection, Limits
from skydog.world.obstacles import Obstacles
from skydog.world.routes import Routes
from skydog.world.sight import Sight
from skydog.world.spread import Spread
from skydog.world.state import State
from skydog.world.vectors import PerSheep, Scalar

Tree = TypeVar("Tree")


class Sheep(eqx.Module):
    """What a sheep's body can do."""

    speed: PerSheep  # V_UGV, m/s: how fast a sheep moves under a force of 1


class Dog(eqx.Module):
    """How dogs fly and where they aim. Lengths in metres, speeds in m/s."""

    speed: Scalar  # the speed limit, of which an action is a share
    driving: Scalar  # driving point: this times √N behind the flock
    collecting: Scalar  # collecting point: this far behind the stray
    airspace: Scalar  # how far beyond the arena's walls a dog may fly
    # Which of the sheep outside f(N) a dog collects: the one with the greatest (distance that it
    # strays - nearness * its distance to the dog). 0: the furthest; 1 prefers one near the dog.
    nearness: Scalar = 0.0
    stall: Scalar = 0.0  # the rule dog stands while a sheep is nearer than this; 0 is off
    actuation_noise: Scalar = 0.0  # SD of the error of each component of a flown velocity
    perception_noise: Scalar = 0.0  # SD of the error of each coordinate that a dog sees
    limits: Any = AnyDirection()  # which velocities it can fly: a `skydog.world.limits.Limits`


class Arena(eqx.Module):
    """The square, or rectangle, that the sheep cannot leave, and the goal. Metres and seconds."""

    size: Scalar  # L: the length of a side; of a rectangle the one along x
    goal_x: Scalar = 0.0
    goal_y: Scalar = 0.0
    goal_radius: Scalar = 2.0  # 𝔻: every sheep must come as near as this to the goal
    dt: Scalar = 0.1
    height: Scalar | None = None  # the side along y; None is a square

    @property
    def sides(self) -> Float[Array, "2"] | Scalar:
        """The sides along x and y, in metres; of a square the one number for both."""
        if self.height is None:
            return self.size
        return jnp.stack([jnp.asarray(self.size), jnp.asarray(self.height)])

    @property
    def scale(self) -> Scalar:
        """How large it is, in metres: the side of the square with the same diagonal."""
        if self.height is None:
            return self.size
        return jnp.sqrt(0.5 * (jnp.square(self.size) + jnp.square(self.height)))

    @property
    def plain_sides(self) -> tuple[float, float]:
        """The sides along x and y, in metres, of an arena that is not traced."""
        return float(self.size), float(self.size if self.height is None else self.height)


class Way(eqx.Module):
    """Which way is home, for a flock and for each of its sheep.

    `drive_direction` is the unit vector along which the flock's centre is to be driven, and
    `distance_home` the metres that it has to go. `stray_distance` is by how many metres each
    sheep strays: beyond f(N) it is fetched, the furthest first. `push_direction` are the vectors
    along which a sheep that strays is to be pushed: a dog stands their length times
    `dog.collecting` behind it, mostly 1.
    """

    drive_direction: Float[Array, "2"]
    distance_home: Float[Array, ""]
    stray_distance: Float[Array, " sheep"]
    push_direction: Float[Array, "sheep 2"]


@runtime_checkable
class Home(Protocol):
    """Which way is home. Any `equinox.Module` with this method is one."""

    def way(self, world: "World", sheep: Float[Array, "sheep 2"]) -> Way:
        """Who strays, where to push it and where to drive. `sheep` are positions in metres."""
        ...


@runtime_checkable
class End(Protocol):
    """When a mission is accomplished. Any `equinox.Module` with this method is one."""

    def accomplished(self, world: "World", state: State) -> Bool[Array, ""]:
        """Whether the mission is accomplished in this state."""
        ...


class World(eqx.Module):
    """Everything that is fixed during a mission: a pytree, for jit and vmap.

    Each part can be exchanged for one of your own with `dataclasses.replace`. The laws among them
    may have parameters of their own; `check` tests that each has its methods.
    """

    flock: Any  # how sheep move: a `skydog.world.laws.Flock`
    sheep: Sheep
    dog: Dog
    arena: Arena
    spread: Any  # f(N), for gate and success: a `skydog.world.spread.Spread`
    home: Any  # which way is home: a `Home`
    end: Any  # when a mission is accomplished: an `End`
    obstacles: Obstacles | None = None  # what stands in the arena
    routes: Routes | None = None  # how dogs go around tall obstacles
    # Where sheep start that are not placed otherwise: least x and y, greatest x and y, in metres.
    start: Float[Array, "*batch 4"] | Float[np.ndarray, "4"] | None = None
    sight: Sight | None = None  # what dogs see of the flock; None is all of it
    # Sheep get used to dogs: while one is in sight, the weight of `escape` falls by exp(-rate * t).
    # The rate is per second; None is never. It does not rise again within a mission.
    habituation: PerSheep | None = None


def check(world: World) -> World:
    """The world, if each of its laws is one. Raises `Refusal`, which names what is missing."""
    for name, law, protocol in (
        ("flock", world.flock, Flock),
        ("dog.limits", world.dog.limits, Limits),
        ("spread", world.spread, Spread),
        ("home", world.home, Home),
        ("end", world.end, End),
    ):
        if isinstance(law, type):
            called = f"{law.__name__}()"
            raise Refusal(f"the world's {name} is the class {law.__name__}; make it {called}")
        methods = [method for method in vars(protocol) if not method.startswith("_")]
        missing = [method for method in methods if not callable(getattr(law, method, None))]
        if missing:
            raise Refusal(
                f"the world's {name}, {short(law)}, has no method {missing[0]!r}; "
                f"see {protocol.__module__}.{protocol.__name__}"
            )
        odd = [leaf for leaf in jax.tree.leaves(law) if not eqx.is_array_like(leaf)]
        if odd and odd[0] is not law:
            raise Refusal(
                f"the world's {name} ({type(law).__name__}) holds {short(odd[0])}, which is no "
                "number and no array; mark its field with equinox.field(static=True)"
            )
        if jax.tree_util.all_leaves([law]):
            raise Refusal(
                f"the world's {name} is a {type(law).__name__}, which jax does not know; "
                "make its class an equinox.Module"
            )
    return world


def noisy(world: World) -> bool:
    """Whether the world asks for random numbers: a mission in it then needs a key.

    A law that does not say so (`Flock`) may.
    """
    dog = world.dog
    shaky = np.any(dog.actuation_noise) or np.any(dog.perception_noise)
    return bool(getattr(world.flock, "noisy", True) or shaky)


def traced(tree: Tree) -> Tree:
    """A world, or a shepherd, with its numbers as arrays.

    Arrays are arguments of a compiled function, so that one compiled function serves all values.
    """

    def array(leaf: object) -> object:
        number = isinstance(leaf, float | np.ndarray) and np.asarray(leaf).dtype.kind == "f"
        return jnp.asarray(leaf, jnp.float32) if number else leaf

    return jax.tree.map(array, tree)
