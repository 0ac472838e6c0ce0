"""A sheepdog as an ONNX file: gate, both skills and limits in one graph that needs no skydog."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from skydog import __version__, files, numerics
from skydog.errors import Refusal
from skydog.shepherds.networks import Actor, GreedyQ
from skydog.shepherds.options import Frame
from skydog.shepherds.sheepdog import COMMANDS, OBSERVES, Sheepdog
from skydog.world import scenes
from skydog.world.home import StraightHome
from skydog.world.limits import AnyDirection, PerAxis
from skydog.world.params import World
from skydog.world.serialise import flatten, own_name
from skydog.world.spread import FixedSpread, SquareRootSpread, TwoThirdsSpread

if TYPE_CHECKING:
    from onnx import ModelProto

# The graph, in ONNX's own text. What it names and does not compute is a constant of the world or
# a weight. Opset 18 and IR 8 are those of ONNX 1.13 (2022), so that older runtimes read it.
GRAPH = """
<ir_version: 8, opset_import: ["": 18, "skydog": 1]>
sheepdog (float[cases, sheep, 2] sheep, float[cases, 2] dog)
    => (float[cases, 2] velocity, float[cases, 2] subgoal, bool[cases] drives)
{
    # herding.gathered: whether every sheep is within f(N) of the flock's centre.
    middle = ReduceMean (sheep, flockmates)
    centre = Squeeze (middle, flockmates)
    out = Sub (sheep, middle)
    away, outward = skydog.polar (out)
    strays = Squeeze (away, coordinates)
    furthest = ReduceMax <keepdims = 0> (strays, flockmates)
    shape = Shape (sheep)
    counted = Gather (shape, flockmates)
    count = Cast <to = 1> (counted)
    SPREAD
    drives = LessOrEqual (furthest, radius)
    behaviour = Unsqueeze (drives, coordinates)

    # herding.driving_points: R √N behind the centre, seen from the goal.
    HOME
    root = Sqrt (count)
    offset = Mul (driving, root)
    back = Mul (offset, behind)
    driving_point = Add (centre, back)

    # herding.collecting_points: R behind the stray, seen from the centre.
    beside = Mul (collecting, outward)
    points = Add (sheep, beside)
    dog_in_row = Unsqueeze (dog, flockmates)
    from_dog = Sub (sheep, dog_in_row)
    apart, away_from_dog = skydog.polar (from_dog)
    gap = Squeeze (apart, coordinates)
    less = Mul (nearness, gap)
    at_hand = Sub (strays, less)
    outside = Greater (strays, radius)
    rank = Where (outside, at_hand, lowest)
    stray = ArgMax <axis = 1, keepdims = 1> (rank)
    collecting_point = GatherND <batch_dims = 1> (points, stray)

    # herding.gate and sheepdog.observe, through ξ.
    chosen = Where (behaviour, driving_point, collecting_point)
    subgoal = Clip (chosen, least, greatest)
    from_centre = Sub (dog, centre)
    from_subgoal = Sub (dog, subgoal)
    both = Concat <axis = 1> (from_centre, from_subgoal)
    seen = Mul (xi, both)

    # frame.fold.
    FOLD

    # networks.Actor or networks.GreedyQ, twice.
    SKILLS
    taken = Where (behaviour, driven, collected)

    # frame.unfold.
    UNFOLD

    # sheepdog.stretched and mission.limited.
    STRETCHED
    asked = Mul (speed, stretched)
    LIMITED

    # A dog hovers where a number is not finite. What is seen is asked too, since a runtime's
    # Relu and ArgMax may make a number of NaN.
    numbers = Concat <axis = 1> (seen, flown)
    nan = IsNaN (numbers)
    infinite = IsInf (numbers)
    broken = Or (nan, infinite)
    marks = Cast <to = 1> (broken)
    mark = ReduceMax <keepdims = 1> (marks, coordinates)
    lost = Cast <to = 9> (mark)
    velocity = Where (lost, nothing, flown)
}
<domain: "skydog", opset_import: ["": 18]>
polar (v) => (length, direction)
{
    # vectors.norm and vectors.unit: the length of a vector, and its direction or zero.
    last = Constant <value_ints = [-1]> ()
    zero = Constant <value_float = 0.0> ()
    one = Constant <value_float = 1.0> ()
    length = ReduceL2 <keepdims = 1> (v, last)
    still = Equal (length, zero)
    divisor = Where (still, one, length)
    direction = Div (v, divisor)
}
<domain: "skydog", opset_import: ["": 18]>
swapped (v, swap) => (w)
{
    # x and y of a vector change places, or not.
    last = Constant <value_ints = [1, 0]> ()
    other = Gather <axis = 1> (v, last)
    w = Where (swap, other, v)
}
"""

# The lines of `frame.fold` and `frame.unfold`, in either frame.
FRAMES: dict[Frame, tuple[str, str]] = {
    "folded": (
        """
    seen_centre, seen_subgoal = Split <axis = 1, num_outputs = 2> (seen)
    off = Sub (seen_centre, seen_subgoal)
    negative = Less (off, nothing)
    sign = Where (negative, minus, plus)
    size = Abs (off)
    along, across = Split <axis = 1, num_outputs = 2> (size)
    swap = Greater (across, along)
    signed_centre = Mul (seen_centre, sign)
    signed_subgoal = Mul (seen_subgoal, sign)
    folded_centre = skydog.swapped (signed_centre, swap)
    folded_subgoal = skydog.swapped (signed_subgoal, swap)
    eyes = Concat <axis = 1> (folded_centre, folded_subgoal)
""",
        """
    unswapped = skydog.swapped (taken, swap)
    action = Mul (unswapped, sign)
""",
    ),
    "paper": ("eyes = Identity (seen)", "action = Identity (taken)"),
}

# The lines of each law that a graph can hold.
SPREADS = {
    TwoThirdsSpread: "power = Pow (count, two_thirds)\n    radius = Mul (length, power)",
    SquareRootSpread: "twice = Add (count, count)\n    side = Sqrt (twice)\n"
    "    radius = Mul (length, side)",
    FixedSpread: "radius = Identity (length)",
}
HOMES = {
    StraightHome: "from_goal = Sub (centre, goal)\n    _, behind = skydog.polar (from_goal)",
}
LIMITS = {
    PerAxis: "flown = Clip (asked, slowest, fastest)",
    AnyDirection: "pace, heading = skydog.polar (asked)\n    slower = Min (pace, speed)\n"
    "    flown = Mul (heading, slower)",
}


@numerics.ours()
def export(path: Path, sheepdog: Sheepdog, world: World, card: dict[str, Any]) -> None:
    """Write a sheepdog that flies in a world as one ONNX file.

    Its inputs are `sheep`, float32 of any number of cases and of sheep by 2, and `dog`, float32
    of cases by 2: positions in metres in the world's frame. Its outputs are `velocity` of the
    dog in m/s, and to log, its `subgoal` in metres and whether it `drives` (else it collects).
    The world's parameters are constants in it; they stand in its metadata as JSON, with `card`,
    which says where the sheepdog comes from. Noise is left out.

    Raises `Refusal` if onnx is missing, if the file cannot be written, or if f(N), the way home or
    the dog's limits are a law of your own, which the file could not hold, or for obstacles.
    """
    files.write_bytes(path, model(sheepdog, world, card).SerializeToString(deterministic=True))


def model(sheepdog: Sheepdog, world: World, card: dict[str, Any]) -> "ModelProto":
    """What `export` writes. Raises `Refusal` as it does."""
    try:
        import onnx
        from onnx import checker, helper, inliner, numpy_helper, parser
    except ImportError:
        raise Refusal("export to ONNX needs onnx; run: pip install 'skydog[onnx]'") from None
    scenes.check_open(world, "an ONNX file")
    # In float32, as a compiled mission has it: whether ξ is 1 decides whether actions stretch.
    xi = float(np.float32(sheepdog.arena) / np.float32(world.arena.size))
    constants = _constants(world, xi)
    skills = [
        line
        for skill, action in (("collect", "collected"), ("drive", "driven"))
        for line in _skill(skill, getattr(sheepdog, skill), action, constants)
    ]
    graph = GRAPH.replace("SKILLS", "\n    ".join(skills))
    fold, unfold = FRAMES[sheepdog.frame]
    graph = graph.replace("UNFOLD", unfold).replace("FOLD", fold)
    graph = graph.replace("STRETCHED", _stretched(sheepdog.drive.stretches and xi != 1.0))
    laws: tuple[tuple[str, object, dict[Any, str]], ...] = (
        ("SPREAD", world.spread, SPREADS),
        ("HOME", world.home, HOMES),
        ("LIMITED", world.dog.limits, LIMITS),
    )
    for place, law, lines in laws:
        kind: Any = type(law)
        if kind not in lines:
            raise Refusal(
                f"an ONNX file holds the laws that ship with skydog, not {own_name(law)}; "
                "export for a world of a preset"
            )
        graph = graph.replace(place, lines[kind])
    made: onnx.ModelProto = parser.parse_model(graph)
    used = {name for node in made.graph.node for name in node.input}
    made.graph.initializer.extend(
        numpy_helper.from_array(array, name) for name, array in constants.items() if name in used
    )
    # As plain nodes, since few runtimes but ONNX's own know functions of a model.
    made = inliner.inline_local_functions(made)
    del made.opset_import[1:]
    made.producer_name, made.producer_version = "skydog", __version__
    made.doc_string = f"The sheepdog {card.get('name', '')}: gate, skills and limits of one dog."
    helper.set_model_props(
        made,
        {
            "card": json.dumps(files.plain(card)),
            "world": json.dumps(files.plain(flatten(world))),
            "observes": json.dumps(OBSERVES),
            "commands": json.dumps(COMMANDS),
            "inputs": "sheep: m, dog: m; x right, y up, from the arena's corner",
            "outputs": "velocity: m/s, subgoal: m, drives: true for driving, false for collecting",
        },
    )
    checker.check_model(made, full_check=True)
    return made


def _constants(world: World, xi: float) -> dict[str, np.ndarray]:
    """What the graph names and takes for granted. Metres, m/s."""
    arena, dog = world.arena, world.dog
    numbers = {
        "goal": [arena.goal_x, arena.goal_y],
        "length": [getattr(world.spread, "length", 0.0)],
        "two_thirds": [2 / 3],
        "driving": [dog.driving],
        "collecting": [dog.collecting],
        "nearness": [dog.nearness],
        "lowest": [-np.inf],
        "minus": [-1.0],
        "plus": [1.0],
        "least": -dog.airspace,
        "greatest": arena.size + dog.airspace,
        "xi": [xi],
        "speed": [dog.speed],
        "slowest": -dog.speed,
        "fastest": dog.speed,
        "nothing": [0.0],
    }
    axes = {"flockmates": np.array([1]), "coordinates": np.array([-1])}
    return {name: np.asarray(value, np.float32) for name, value in numbers.items()} | axes


def _skill(
    name: str, skill: Actor | GreedyQ, action: str, constants: dict[str, np.ndarray]
) -> list[str]:
    """The lines of a skill, from `eyes` to `action`; its weights are added to the constants."""
    lines, x = [], "eyes"
    for depth, linear in enumerate(skill.layers.linears):
        weight, bias, y = f"{name}_{depth}_weight", f"{name}_{depth}_bias", f"{name}_{depth}"
        constants[weight], constants[bias] = np.asarray(linear.weight), np.asarray(linear.bias)
        if depth:
            lines.append(f"{x}_on = Relu ({x})")
            x = f"{x}_on"
        lines.append(f"{y} = Gemm <transB = 1> ({x}, {weight}, {bias})")
        x = y
    if isinstance(skill, Actor):
        return [*lines, f"{action} = Tanh ({x})"]
    # The step of each of the actions, as the skill tells it.
    count = constants[f"{name}_{len(skill.layers.linears) - 1}_bias"].size
    constants[f"{name}_steps"] = np.asarray(skill.best(jnp.eye(count)))
    best = f"{name}_best = ArgMax <axis = 1, keepdims = 0> ({x})"
    return [*lines, best, f"{action} = Gather ({name}_steps, {name}_best)"]


def _stretched(stretches: bool) -> str:
    if not stretches:
        return "stretched = Identity (action)"
    return "longer = Div (action, xi)\n    stretched = Tanh (longer)"
