"""A shepherd by its name: ours, somebody's code, and the files of others."""

import hashlib
from pathlib import Path
from typing import Any

import equinox as eqx
import jax

from skydog import files, numerics, references
from skydog.errors import Refusal
from skydog.shepherds import finding, rules, store
from skydog.shepherds.foreign import Policy, from_policy
from skydog.world import mission, params
from skydog.world.mission import Shepherd
from skydog.world.params import World
from skydog.world.state import State

LARGEST = 1 << 30  # bytes of a file


def load(name: str | Path) -> Any:
    """A shepherd by its name, as the commands take it.

    `load("h-ddpg-4x4")` is a sheepdog that ships. Others are named by their file or run folder, a
    rule by its name, `team:SHEEPDOG`, code by FILE.py:NAME or package.module:NAME, what
    `skydog export` wrote by FILE.onnx, a model of Stable-Baselines3 by ppo:FILE.zip (or a2c, ddpg,
    sac, td3), and what `store.save` wrote of a policy by policy:FILE. Code, zips and what the
    file of a policy names are run: only load what you trust. Raises `Refusal` as `read` does.
    """
    return read(name)[0]


@numerics.ours()
def read(name: str | Path) -> tuple[Shepherd, dict[str, Any]]:
    """A shepherd by its name, and its card, which is empty for a rule.

    Raises `Refusal` for what there is not, is damaged, fails, or is no shepherd.
    """
    called = str(name)
    finding.check(called)
    which, card = finding.kind(called), {"name": finding.title(called)}
    if which == "saved":
        return _saved(finding.find(Path(called.removeprefix(finding.SAVED))))
    if which == "zip":
        return from_policy(called), card
    if which == "onnx":
        from skydog.shepherds import onnx_dog

        return onnx_dog.read(Path(called))
    if which == "code":
        return _coded(called), card
    return rules.read(name)


def digest(name: str) -> str:
    """What a name means by now, as text: another one if its file has changed since."""
    which = finding.kind(name)
    if which == "rule":
        return "rule"
    if which == "code":
        in_file = references.split(name)
        return "package" if in_file is None else _hash(in_file[0])
    tail = name.partition(":")[2] if which in ("team", "saved", "zip") else name
    file = Path(tail) if which in ("zip", "onnx") else finding.find(Path(tail))
    if (
        which == "saved"
        and finding.kind(code := str(store.policy_card(file).get("code"))) == "code"
    ):
        return f"{_hash(file)} {digest(code)}"  # of a zip the card holds the hash
    return _hash(file)


def trial(name: str, shepherd: Shepherd, world: World, starts: State) -> None:
    """Raise `Refusal` for a shepherd that fails in a world; only its shapes are computed.

    `starts` are stacked along a first axis. A `Foreign` function is called once.
    """
    start = jax.tree.map(lambda leaf: leaf[0], starts)
    try:
        eqx.filter_eval_shape(
            lambda world, start: mission.decide(world, shepherd, start),
            params.traced(world),
            start,
        )
    except Refusal as refusal:
        raise refusal if name in str(refusal) else Refusal(f"{name}: {refusal}") from refusal
    except (Exception, SystemExit) as problem:  # whatever code of others may do
        in_file = references.split(name) if finding.kind(name) == "code" else None
        file = None if in_file is None else in_file[0]
        raise references.failed(f"the shepherd {name}", file, problem) from problem


def _hash(file: Path) -> str:
    return hashlib.sha256(files.read_bytes(file, "shepherd's file", LARGEST)).hexdigest()


def _coded(name: str) -> Shepherd:
    found = references.load(name)
    if hasattr(found, "predict") and not isinstance(found, Policy):
        raise Refusal(
            f"{name} is a model; write dog = skydog.from_policy(model.predict), name that"
        )
    try:
        return references.made(found, name, None, None)
    except Refusal as refusal:
        if "arguments" not in str(refusal):
            raise
        raise Refusal(
            f"{refusal}; a shepherd is a function of world and state, or something without "
            "arguments that makes one. For a policy on observations see skydog.from_policy"
        ) from None


def _saved(file: Path) -> tuple[Shepherd, dict[str, Any]]:
    card = store.policy_card(file)
    code, sha256 = str(card.get("code")), card.get("sha256")
    if finding.kind(code) == "zip":
        algorithm, _, zipped = code.partition(":")
        path = file.parent / zipped
        content = files.read_bytes(path, "model", LARGEST)
        if hashlib.sha256(content).hexdigest() != sha256:
            raise Refusal(f"{path} has changed since {file} was written; save the policy again")
        code = f"{algorithm}:{path}"
    return from_policy(code, card.get("observation"), card.get("divide_by", 1.0)), card
