"""Presets: named worlds, every value with its source."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx

from skydog import quantities
from skydog.errors import Refusal, short
from skydog.world import mixing, scenefile, scenes
from skydog.world.end import AllHome, ShareHome
from skydog.world.home import StraightHome
from skydog.world.laws.diffusive import DiffusiveFlock, diffusing
from skydog.world.laws.elfiqi import RegulatedFlock
from skydog.world.laws.literal import LiteralFlock
from skydog.world.laws.paper import PaperFlock
from skydog.world.laws.strombom import StrombomFlock
from skydog.world.limits import AnyDirection, PerAxis
from skydog.world.params import Arena, Dog, Sheep, World, check
from skydog.world.spread import FixedSpread, Spread, SquareRootSpread, TwoThirdsSpread

Point = tuple[float, float]
"""A place in the arena: x and y in metres."""


def paper(arena: float = 4.0, sheep: int = 3) -> World:
    """Nguyen et al. 2020 (arXiv 2004.11543), Table "Parameters in setups".

    What the paper leaves open is filled from its authors' group (El-Fiqi et al. 2020) and
    from Strömbom et al. 2014, and marked so.
    """
    scale = max(1.0, math.sqrt(sheep / 3))
    return World(
        flock=PaperFlock(
            avoidance=1.0,  # paper, Table "setups": R_ππ
            # paper, Table "setups": R_πβ, for its N = 3. From five sheep on the driving point is
            # further from the flock's centre than that: sight grows as the flock does (ours).
            sensing=2.0 * scale,
            inertia=0.5,  # not in the paper; Strömbom 2014 (h), El-Fiqi 2020
            grouping=1.05,  # not in the paper; Strömbom 2014 (c), El-Fiqi 2020
            escape=1.0,  # not in the paper; Strömbom 2014 (ρ_s), El-Fiqi 2020
            # El-Fiqi 2020. The paper's table prints "W_ππ 0.5 (m)", in metres: see `paper-w05`.
            repulsion=2.0,
        ),
        sheep=Sheep(speed=0.5),  # paper, Table "setups": V_UGVs
        dog=Dog(
            speed=1.0,  # paper, "Action and state space": [-1, 1] m/s on each axis
            driving=1.0,  # paper, "Problem Formulation": R_ππ √N behind the flock
            collecting=1.0,  # paper, "Problem Formulation": R_ππ behind the stray
            airspace=1.4,  # not in the paper; its authors' laboratory code, 2019
            # Ours, so that a dog does not commute between strays that are equally far. The paper
            # takes the furthest, which is 0: `furthest_first`.
            nearness=1.0,
            stall=0.0,  # Strömbom's 3 R_ππ is 3 m here and would stall the dog for good
            limits=PerAxis(),  # paper, "Action and state space"
        ),
        arena=Arena(
            size=arena,  # paper, "Experimental setups": 4 and 6 m
            # paper, Table "setups": 𝔻, for its N = 3. Ten sheep, a metre apart, do not fit in
            # the quarter disc that lies in the arena: the goal grows as the flock does (ours).
            goal_radius=2.0 * scale,
            dt=0.1,  # paper, Table "setups"; the goal (0, 0) is from the laboratory code
        ),
        # paper, Table "setups": f(N) = 1.3 m, for its N = 3 (Eq. 7 would give 2.08 m).
        spread=TwoThirdsSpread(length=1.3 / 3 ** (2 / 3)),
        home=StraightHome(),  # paper, "Problem Formulation"
        end=AllHome(),  # paper, Eq. 12
    )


def paper_w05(arena: float = 4.0, sheep: int = 3) -> World:
    """The `paper` preset with the paper's printed W_ππ = 0.5 (Table "Parameters in setups")."""
    return eqx.tree_at(lambda w: w.flock.repulsion, paper(arena, sheep), 0.5)


def paper_literal(arena: float = 4.0, sheep: int = 3) -> World:
    """The `paper` preset with the paper's Eq. 6 as printed: forces that are not normalised."""
    world = paper(arena, sheep)
    return replace(world, flock=LiteralFlock(**vars(world.flock)))


def paper_physical(arena: float = 6.0, sheep: int = 3) -> World:
    """The `paper` preset as its Section "Evaluating on physical system" has it: dt is 0.2 s."""
    world = paper(arena, sheep)
    return replace(
        world,
        arena=replace(world.arena, dt=0.2),  # paper, "Testing"
        # Ours: a room of 6 m has no 1.4 m to spare beyond it. With none at all, a dog cannot get
        # behind a sheep at the wall.
        dog=replace(world.dog, airspace=0.2),
    )


def strombom2014(arena: float = 150.0, sheep: int = 3) -> World:
    """Strömbom et al. 2014 (J. R. Soc. Interface 11), for a flock of any size.

    Its units are a step and "about a metre"; one step is one second here.
    """
    spread = TwoThirdsSpread(length=2.0)  # f(N) = r_a N^(2/3)
    return World(
        flock=StrombomFlock(
            avoidance=2.0,  # r_a
            sensing=65.0,  # r_s
            inertia=0.5,  # h
            grouping=1.05,  # c
            escape=1.0,  # ρ_s
            repulsion=2.0,  # ρ_a
            noise=0.3,  # e
            graze=0.05,  # p
            neighbours=None,  # n = N - 1, the largest that the paper studies
        ),
        sheep=Sheep(speed=1.0),  # δ
        dog=Dog(
            speed=1.5,  # δ_s
            driving=2.0,  # r_a √N behind the flock
            collecting=2.0,  # r_a behind the stray
            airspace=arena,  # the original dog knows no walls; ours keeps numbers finite
            stall=6.0,  # 3 r_a
            limits=AnyDirection(),
        ),
        arena=_strombom_arena(arena, spread, sheep),
        spread=spread,
        home=StraightHome(),
        end=AllHome(),
    )


def strombom2014_sqrt(arena: float = 150.0, sheep: int = 3) -> World:
    """The `strombom2014` preset with El-Fiqi's f(N) = r_a √(2N): for hundreds of sheep and more.

    N^(2/3) outgrows a real flock, so that a scattered flock of 1,000 counts as gathered.
    """
    spread = SquareRootSpread(length=2.0)  # El-Fiqi et al. 2020
    return replace(
        strombom2014(arena, sheep),
        spread=spread,
        arena=_strombom_arena(arena, spread, sheep),
    )


def _strombom_arena(size: float, spread: Spread, sheep: int) -> Arena:
    # Arrival within 10 of the target, there for the centre of mass; a flock that fills a wider
    # circle, of radius f(N), needs a wider goal (ours).
    return Arena(size=size, goal_radius=max(10.0, float(spread.radius(sheep))), dt=1.0)


def elfiqi2020(arena: float = 50.0, sheep: int = 3) -> World:
    """El-Fiqi et al. 2020 (IEEE Access 8), "Table 2", for a flock of any size; they fly 100.

    The values are those of the program that its authors publish (Hebaelfiqi/Shepherding,
    InputFiles/Config.xml and tools/native_battery.py). One step is one second here.
    """
    spread = SquareRootSpread(length=0.4)  # fNequation 1: f = Ra_pi_pi √(2N)
    gap = 4.0  # R2
    # S_t_beta_j times W_e_beta_j times eta: the most of each component of a uniform error.
    jitter = 2.0 * 0.3 * 0.05
    return World(
        flock=RegulatedFlock(
            avoidance=0.4,  # Ra_pi_pi
            sensing=65.0,  # R_pi_beta
            inertia=0.5,  # W_pi_upsilon
            grouping=1.05,  # W_pi_Lambda
            escape=1.0,  # W_pi_beta
            repulsion=2.0,  # W_pi_pi
            noise=0.3 * 0.05,  # W_e_pi_i times eta
            neighbourhood=3.0,  # Rs_pi_pi
            decay=2.0,  # ModulationDecayFactor
            reach=10.0,  # R3
            threat=2.0,  # S_t_beta_j, over the speed of a sheep
        ),
        sheep=Sheep(speed=1.0),  # S_t_pi_i, SheepAgent.h
        dog=Dog(
            speed=2.0,  # S_t_beta_j
            # DrivingPositionEq 1: f + R2 behind the flock.
            driving=(spread.radius(sheep) + gap) / math.sqrt(sheep),
            collecting=gap,  # CollectingPositionEq 1: R2 behind the stray
            airspace=arena,  # theirs knows no walls; ours keeps numbers finite
            stall=0.0,  # StallingON 0
            actuation_noise=jitter / math.sqrt(3.0),  # the SD of that uniform error
            limits=AnyDirection(),
        ),
        arena=Arena(
            size=arena,  # FieldWidth; theirs has no walls
            goal_x=arena / 2,  # x of 25 in their field of 50
            goal_y=arena,  # y of 50
            # GoalRadius; a flock that fills a wider circle needs a wider goal (ours).
            goal_radius=max(10.0, spread.radius(sheep)),
            dt=1.0,
        ),
        spread=spread,
        home=StraightHome(),
        end=ShareHome(1.0),  # PaddockON 0
    )


def lama2024(arena: float = 50.0, sheep: int = 3) -> World:
    """Lama & di Bernardo 2024 (arXiv 2307.16797): targets that diffuse and do not hold together.

    Sizes, speeds and dt are those of the herdability map of Covone et al. 2025 (arXiv 2504.02479;
    github.com/stefanocovone/shepherding), which has a box around the plane. The goal is a disc in
    the middle. A unit of length is a metre here, one of time a second.
    """
    dt = 0.05  # Covone
    return World(
        flock=DiffusiveFlock(
            sensing=2.5,  # λ, both
            strength=3.0,  # k, both
            noise=diffusing(1.0, dt),  # D = 1, both
        ),
        sheep=Sheep(speed=1.0),  # the law's forces are velocities
        dog=Dog(
            speed=8.0,  # Covone; Lama 7.5
            driving=1.25,  # ours, for dogs that drive a flock as a whole
            collecting=1.25,  # δ = λ/2, both
            airspace=0.0,  # Covone: the box holds the dogs too
            # As Covone's code, which made the figures of the field: up to 11.3 on a diagonal.
            # Lama limits the velocity's length.
            limits=PerAxis(),
        ),
        arena=Arena(
            size=arena,  # Covone: 50
            goal_x=arena / 2,
            goal_y=arena / 2,
            goal_radius=arena / 10,  # Covone: 5 in 50
            dt=dt,
        ),
        spread=FixedSpread(arena / 10),  # ours: a gathered flock is one that fits in the goal
        home=StraightHome(),
        end=ShareHome(0.99),  # both: χ ≥ 0.99
    )


PRESETS: dict[str, Callable[..., World]] = {
    "paper": paper,
    "paper-w05": paper_w05,
    "paper-literal": paper_literal,
    "paper-physical": paper_physical,
    "strombom2014": strombom2014,
    "strombom2014-sqrt": strombom2014_sqrt,
    "elfiqi2020": elfiqi2020,
    "lama2024": lama2024,
}


def preset(
    name: str = "paper",
    arena: float | None = None,
    sheep: int = 3,
    goal: Point | None = None,
    goal_radius: float | None = None,
    scene: str | Path | None = None,
    mix: Mapping[str, Any] | None = None,
) -> World:
    """A world by the name of its preset, for `sheep` sheep in an arena of `arena` metres.

    `goal`, x and y, and its radius 𝔻 are in metres too; what is None is the preset's own.
    `scene` puts it among obstacles: the name of a scene, or a file (`skydog.world.scenes`).
    `mix` gives shares of the flock to other kinds of sheep (`skydog.world.mixing`).
    Raises `Refusal` for an unknown name, an arena that is not wider than the goal's radius, a
    goal outside the arena, or a flock of fewer than one sheep.
    """
    if not isinstance(name, str) or name not in PRESETS:
        raise Refusal(f"no preset is called {short(name)}; choose from {', '.join(PRESETS)}")
    world = make(PRESETS[name], arena, sheep, goal, goal_radius, scene)
    return world if mix is None else mixing.mixed(world, sheep, mix)


def make(
    maker: Callable[..., World],
    arena: float | None = None,
    sheep: int = 3,
    goal: Point | None = None,
    goal_radius: float | None = None,
    scene: str | Path | None = None,
) -> World:
    """The world that a function of `arena` and `sheep` makes, as the presets are.

    What is None is the function's own; a scene has a goal of its own. Raises `Refusal` as `preset`
    does, and for a law without its methods.
    """
    sheep = quantities.SHEEP.checked(sheep)
    if goal_radius is not None:
        goal_radius = quantities.GOAL_RADIUS.checked(goal_radius)
    if arena is not None:
        arena = quantities.ARENA.checked(arena)
    if scene is not None:
        return _in_scene(maker, arena, sheep, goal, goal_radius, scene)
    world = check(maker(sheep=sheep, **({} if arena is None else {"arena": arena})))
    placed = _with_goal(world, goal, goal_radius)
    return placed if goal is None and goal_radius is None else scenes.renewed(placed)


def _in_scene(
    maker: Callable[..., World],
    arena: float | None,
    sheep: int,
    goal: Point | None,
    goal_radius: float | None,
    scene: str | Path,
) -> World:
    own = check(maker(sheep=sheep))
    if str(scene) not in scenes.SCENES and Path(scene).suffix:
        if arena is not None:
            raise Refusal(f"the scene {scene} has an arena of its own; leave out --arena {arena:g}")
        place = scenefile.read(Path(scene))
    else:
        radius = own.arena.goal_radius if goal_radius is None else goal_radius
        side = float(math.ceil(scenes.ROOM * float(radius))) if arena is None else arena
        place = scenes.named(str(scene), side, scenes.passage(own))
    wide = quantities.ARENA.checked(max(place.sides))
    quantities.ARENA.checked(min(place.sides))
    world = scenes.placed(check(maker(sheep=sheep, arena=wide)), place)
    return scenes.with_home(_with_goal(world, goal, goal_radius))


def with_nearness(world: World, nearness: float) -> World:
    """The world whose gate chooses strays so (see `Dog.nearness`). Raises `Refusal`."""
    nearness = quantities.NEARNESS.checked(nearness)
    return replace(world, dog=replace(world.dog, nearness=nearness))


def at_speed(world: World, share: float) -> World:
    """The world in which dogs and sheep move at a share of their speed. Raises `Refusal`."""
    share = quantities.SPEED.checked(share)
    dog = replace(world.dog, speed=share * world.dog.speed)
    return replace(world, dog=dog, sheep=replace(world.sheep, speed=share * world.sheep.speed))


def furthest_first(world: World) -> World:
    """The world with the paper's gate, which has the furthest stray collected first."""
    return with_nearness(world, 0.0)


def has_own_goal(world: World, name: str, sheep: int) -> bool:
    """Whether a preset's world has the goal that the preset has by itself."""
    own, here = PRESETS[name](arena=world.arena.size, sheep=sheep).arena, world.arena
    return (here.goal_x, here.goal_y, here.goal_radius) == (own.goal_x, own.goal_y, own.goal_radius)


def _with_goal(world: World, goal: Any, goal_radius: float | None) -> World:
    """The world with its goal at another place or of another radius; None is its own."""
    if goal_radius is not None:
        world = replace(world, arena=replace(world.arena, goal_radius=goal_radius))
    radius, sides = world.arena.goal_radius, world.arena.plain_sides
    if not radius < min(sides):
        raise Refusal(
            f"arena must be longer than {radius:g} m (the goal disc), got {min(sides)}; "
            f"try --arena {2 * radius:g}"
        )
    for side in sides:
        quantities.ARENA.checked(side)
    placed = _moved_goal(world, (world.arena.goal_x, world.arena.goal_y) if goal is None else goal)
    return world if goal is None else placed


def _moved_goal(world: World, goal: Any) -> World:
    sides = world.arena.plain_sides
    try:
        x, y = (float(at) for at in goal)
    except (TypeError, ValueError, OverflowError):
        raise Refusal(f"a goal is x and y in metres, got {short(goal)}; try (4, 4)") from None
    # A side that was rounded to float32 may be a little longer.
    within = all(0.0 <= at <= side * (1 + 1e-6) for at, side in zip((x, y), sides, strict=True))
    if isinstance(goal, str) or not within:
        wide, high = sides
        reach = f"from 0 to {wide:g} m on each axis" if wide == high else f"{wide:g} x {high:g} m"
        raise Refusal(
            f"the goal lies in the arena, {reach}, got {x:g},{y:g}; try --goal {wide:g},{high:g}"
        )
    x, y = min(x, sides[0]), min(y, sides[1])
    return replace(world, arena=replace(world.arena, goal_x=x, goal_y=y))
