"""The live view: a flock to play with in the browser. Needs: pip install 'skydog[watch]'.

A server on loopback computes, a page draws, and each page has a `session` of its own.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from skydog.errors import Refusal
from skydog.shepherds import finding, named, rules, store
from skydog.shepherds.sheepdog import Sheepdog
from skydog.view import session as sessions
from skydog.view.connection import Cards, Pages
from skydog.view.messages import LONGEST_ARENA, MOST_DOGS, MOST_SHEEP
from skydog.view.server import Server, listening
from skydog.view.session import Settings, Worlds
from skydog.world.mission import Shepherd
from skydog.world.presets import PRESETS, Point, make


def policies(chosen: str) -> dict[str, Shepherd]:
    """The shepherds to choose from: the rule dogs, all that ship, and the chosen one, first.

    `chosen` is a name among them, or a sheepdog's file or run folder. Raises `Refusal` as
    `store.load` does.
    """
    ruled = {name: rule() for name, rule in rules.RULES.items()}
    first = {chosen: named.read(chosen)[0]}
    return first | ruled | {name: store.load(name) for name in store.ships()} | first


def cards(shepherds: Mapping[str, Shepherd]) -> dict[str, dict[str, Any]]:
    """The cards of the sheepdogs among `policies`, by name."""
    learnt = [name for name, steers in shepherds.items() if isinstance(steers, Sheepdog)]
    learnt = [name for name in learnt if finding.kind(name) == "sheepdog"]
    return {name: store.read(name)[1] for name in learnt}


def serve(
    shepherds: dict[str, Shepherd],
    chosen: str,
    preset: str = "paper",
    arena: float | None = None,
    sheep: int = 3,
    dogs: int = 1,
    host: str = "127.0.0.1",
    port: int = 8020,
    worlds: Worlds = PRESETS,
    goal: Point | None = None,
    goal_radius: float | None = None,
    cards: Cards | None = None,
    scene: str | None = None,
) -> Server:
    """Serve the live view, from a thread of its own: returns at once, also in a notebook.

    `url` of what is returned is the address of the page; `wait()` waits for Ctrl-C, and `close()`
    ends it. Pages choose among `shepherds` and `worlds` by name, and begin with the `chosen`
    shepherd and the `preset`. `cards` tell what each sheepdog was taught for. A port of 0 is any
    that is free. Raises `Refusal` for a world that cannot be, and for an address that cannot be
    listened at.
    """
    begin = opening(shepherds, chosen, preset, arena, sheep, dogs, worlds, goal, goal_radius, scene)
    return Server(listening(Pages(shepherds, begin, worlds, cards or {}), host, port))


def opening(
    shepherds: dict[str, Shepherd],
    chosen: str,
    preset: str = "paper",
    arena: float | None = None,
    sheep: int = 3,
    dogs: int = 1,
    worlds: Worlds = PRESETS,
    goal: Point | None = None,
    goal_radius: float | None = None,
    scene: str | None = None,
) -> Settings:
    """What a page begins with. Raises `Refusal` for what the live view does not show."""
    if chosen not in shepherds:
        raise Refusal(f"no shepherd is called {chosen!r}; choose from {', '.join(shepherds)}")
    if not 1 <= sheep <= MOST_SHEEP:
        raise Refusal(f"the live view has 1 to {MOST_SHEEP} sheep, got {sheep}; try --sheep 60")
    if not 1 <= dogs <= MOST_DOGS:
        raise Refusal(f"the live view has 1 to {MOST_DOGS} dogs, got {dogs}; try --dogs 3")
    if goal_radius is not None and not 0.0 < goal_radius <= LONGEST_ARENA / 2:
        raise Refusal(
            f"the goal's radius is at most {LONGEST_ARENA / 2:g} m, got {goal_radius}; "
            "try --goal-radius 2"
        )
    if preset not in worlds:
        raise Refusal(f"no preset is called {preset!r}; choose from {', '.join(worlds)}")
    if arena is not None:
        make(worlds[preset], float(arena), sheep, goal, goal_radius, scene)
    if arena is not None and arena > LONGEST_ARENA:
        raise Refusal(f"arena must be at most {LONGEST_ARENA:g} m, got {arena}; try --arena 20")
    begin = sessions.with_preset(Settings(policy=chosen, sheep=sheep), preset, worlds)
    begin = replace(begin, arena=None if arena is None else float(arena), sheep=sheep, dogs=dogs)
    begin = replace(begin, goal=goal, goal_radius=goal_radius, scene=scene)
    sessions.new(begin, worlds)
    return begin
