"""A trained sheepdog as a file: weights in safetensors, and a card that says what they are."""

import hashlib
import re
from pathlib import Path
from typing import Any, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from skydog import files, numerics, references
from skydog.arrays import kind_of, load_arrays, save_arrays
from skydog.errors import Refusal
from skydog.shepherds.finding import FILE as FILE
from skydog.shepherds.finding import ZOO as ZOO
from skydog.shepherds.finding import find as find
from skydog.shepherds.finding import kind
from skydog.shepherds.finding import ships as ships
from skydog.shepherds.foreign import Policy
from skydog.shepherds.navigate import SEES
from skydog.shepherds.networks import Actor, GreedyQ
from skydog.shepherds.options import Frame
from skydog.shepherds.sheepdog import COMMANDS, OBSERVES, Sheepdog

KIND, POLICY = "sheepdog", "policy"
POLICIES = {"actor": Actor, "chooser": GreedyQ}  # what a card calls the kinds of skills
LARGEST = 1 << 26  # bytes
LONGEST_NAME = 60  # characters
DEEPEST, WIDEST = 16, 4096  # layers, nodes a layer


def save(path: Path, sheepdog: Sheepdog | Policy, card: dict[str, Any]) -> None:
    """Write a sheepdog and its card, and the card once more as Markdown for people.

    `card` tells where it comes from: preset, lesson, seed, versions, measured results. What
    the sheepdog observes and commands, its arena and its frame are added here.

    Of a policy (`skydog.from_policy`) the card is all: it names its code, or its zip and what that
    holds (SHA-256). Raises `Refusal` for a policy that has no name, and for another shepherd.
    """
    if isinstance(sheepdog, Policy):
        card = _named(Path(path), sheepdog) | files.plain(card)
        save_arrays(path, {}, card)
        files.write_text(path.with_suffix(".md"), readable(card))
        return
    if not isinstance(sheepdog, Sheepdog):
        raise Refusal(
            f"a {type(sheepdog).__name__} has no file; name it as a rule, or as FILE.py:NAME"
        )
    card = {
        "kind": KIND,
        "observes": list(OBSERVES),
        "commands": list(COMMANDS),
        "arena": float(sheepdog.arena),
        "frame": sheepdog.frame,
        "policy": next(name for name, kind in POLICIES.items() if isinstance(sheepdog.drive, kind)),
        **({} if sheepdog.navigate is None else {"navigates": list(SEES)}),
        **files.plain(card),
    }
    arrays = {
        f"{skill}.{depth}.{part}": np.asarray(getattr(linear, part))
        for skill in ("collect", "drive", *(["navigate"] if sheepdog.navigate is not None else []))
        for depth, linear in enumerate(getattr(sheepdog, skill).layers.linears)
        for part in ("weight", "bias")
    }
    save_arrays(path, arrays, card)
    files.write_text(path.with_suffix(".md"), readable(card))


def load(path: str | Path) -> Sheepdog:
    """A sheepdog, by its name in the zoo, from its file or from its run folder.

    `load("h-ddpg-4x4")` is one that ships; `ships` lists them. Raises `Refusal` as `read` does.
    """
    return read(path)[0]


@numerics.ours()
def read(path: str | Path) -> tuple[Sheepdog, dict[str, Any]]:
    """A sheepdog and its card, by its name in the zoo, from its file or from its run folder.

    Raises `Refusal` for a file that is missing, damaged, foreign, or of a sheepdog that
    observes or commands something else than this version of skydog gives.
    """
    path = find(Path(path))
    if kind_of(path) == POLICY:
        raise Refusal(f"{path} is a policy, whose code is run; if you trust it, say policy:{path}")
    arrays, card = load_arrays(path, KIND, LARGEST)
    expected = {"observes": OBSERVES, "commands": COMMANDS}
    if card.get("navigates") is not None:
        expected["navigates"] = SEES
    for what, ours in expected.items():
        theirs = card.get(what)
        if theirs != list(ours):
            count = len(theirs) if isinstance(theirs, list) else "other"
            raise Refusal(
                f"{path} {what} {count} numbers, this mission has {len(ours)} "
                f"({', '.join(ours)}); train it again"
            )
    arena = card.get("arena")
    if not isinstance(arena, int | float) or not 0.0 < arena < 1e6:
        raise Refusal(f"{path} is damaged: its card gives an arena of {arena!r} m")
    policy = POLICIES.get(str(card.get("policy")))
    if policy is None:
        raise Refusal(
            f"{path} has skills of the kind {card.get('policy')!r}, this version of skydog knows "
            f"{', '.join(POLICIES)}; train it again"
        )
    # Before there was a choice, all saw the world in the paper's frame.
    frame: Any = card.get("frame", "paper")
    if frame not in get_args(Frame):
        raise Refusal(
            f"{path} sees in the frame {frame!r:.60}, this version of skydog knows "
            f"{', '.join(get_args(Frame))}; train it again"
        )
    seen = len(OBSERVES)
    collect, drive = (_skill(path, skill, arrays, policy, seen) for skill in ("collect", "drive"))
    navigate = None
    if "navigates" in expected:
        navigate = _skill(path, "navigate", arrays, Actor, len(SEES))
    return Sheepdog(collect, drive, float(arena), frame, navigate), card


def policy_card(path: Path) -> dict[str, Any]:
    """The card of a policy that `save` wrote. Raises `Refusal` for another file."""
    return load_arrays(path, POLICY, LARGEST)[1]


def called(path: str | Path, card: dict[str, Any]) -> str | None:
    """What a sheepdog is called in tables: as its card says, or else as its file; None for a rule.

    The name may become that of a file: other letters than those of our own names are dashes.
    """
    if not card:
        return None
    name = card.get("name")
    if not isinstance(name, str) or not name:
        file = find(Path(path))
        name = file.absolute().parent.name if file.name == FILE else file.stem
    return re.sub(r"[^A-Za-z0-9_+.-]", "-", name[:LONGEST_NAME]).strip(".-") or "sheepdog"


def readable(card: dict[str, Any]) -> str:
    """A card as Markdown: the plain facts first, then a section for each list and group."""
    facts = {name: value for name, value in card.items() if not isinstance(value, dict | list)}
    fly = "Fly it: `skydog test` and its name, if it ships, else the path of its folder."
    if card.get("kind") == POLICY:
        fly = "Fly it: `skydog test policy:` and the path of its folder; what it names is run."
    lines = [f"# A {card.get('kind', KIND)}", "", fly, ""]
    lines += [f"- {name}: {_short(value)}" for name, value in facts.items()]
    for name, value in card.items():
        if isinstance(value, list):
            lines += ["", f"## {name}", ""]
            lines += [f"{place}. {_short(item)}" for place, item in enumerate(value, 1)]
        elif isinstance(value, dict):
            lines += ["", f"## {name}", ""]
            lines += [f"- {inner}: {_short(item)}" for inner, item in value.items()]
    return "\n".join([*lines, ""])


def _named(path: Path, policy: Policy) -> dict[str, Any]:
    """The card of a policy: what is loaded again, and how it observes. Raises `Refusal`."""
    code = policy.predict.reference
    if code is None:
        raise Refusal(
            f"{policy.predict.called} lives in this program alone; save the model and name it, as "
            'in skydog.from_policy("ppo:model.zip") or skydog.from_policy("my_dog.py:predict")'
        )
    card: dict[str, Any] = {"kind": POLICY, "observation": policy.observation}
    card["divide_by"] = float(policy.divide_by)
    if kind(code) == "zip":
        algorithm, _, zipped = code.partition(":")
        content = files.read_bytes(Path(zipped), "model")
        card["sha256"] = hashlib.sha256(content).hexdigest()
        # Beside the card, if it is there: so that a folder can be moved.
        zipped, folder = Path(zipped).resolve(), path.resolve().parent
        code = (
            f"{algorithm}:{zipped.relative_to(folder) if zipped.is_relative_to(folder) else zipped}"
        )
    elif (in_file := references.split(code)) is not None:
        code = f"{in_file[0].resolve()}:{in_file[1]}"
    return card | {"code": code}


def _skill(
    path: Path,
    skill: str,
    arrays: dict[str, np.ndarray],
    policy: type[Actor] | type[GreedyQ],
    seen: int,
) -> Any:
    depth = sum(name.startswith(f"{skill}.") and name.endswith(".weight") for name in arrays)
    nodes = [seen]
    weights: list[Array] = []
    if not 1 <= depth <= DEEPEST:
        raise Refusal(f"{path} is damaged: {skill} has {depth} layers")
    for layer in range(depth):
        weight = arrays.get(f"{skill}.{layer}.weight", np.zeros(0))
        bias = arrays.get(f"{skill}.{layer}.bias", np.zeros(0))
        fits = weight.shape == (bias.size, nodes[-1]) and bias.shape == weight.shape[:1]
        if not fits or not 1 <= bias.size <= WIDEST or not weight.dtype == bias.dtype == np.float32:
            raise Refusal(f"{path} is damaged: layer {layer} of {skill} has shape {weight.shape}")
        nodes.append(bias.size)
        weights += [jnp.asarray(weight), jnp.asarray(bias)]
    # Its shape alone: drawing weights to throw them away would take a second.
    blank = eqx.filter_eval_shape(
        policy, nodes[0], len(COMMANDS), tuple(nodes[1:-1]), jax.random.key(0)
    )
    if nodes[-1] != blank.layers.linears[-1].out_features:
        raise Refusal(f"{path} is damaged: {skill} has {nodes[-1]} outputs")
    return jax.tree.unflatten(jax.tree.structure(blank), weights)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
