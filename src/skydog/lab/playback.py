"""A flight log as a tracker: what motion capture saw in a flight, seen again."""

import time
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any

from skydog.errors import Refusal
from skydog.lab import bag, flightlog
from skydog.lab.adapters import Body

SEEN = "/seen"  # how the topics end


class Playback:
    """The raw poses of a flight log, at the pace of the flight from the first `wait` on.

    `fast` gives at every `wait` the next pose of every body at once. Bodies go by the names that
    they had. After the end nothing comes any more. Raises `Refusal` for a file that is no flight
    log, or in which nothing was seen.
    """

    def __init__(self, path: Path, fast: bool = False):
        self._fast = fast
        self._poses = _poses(bag.find(path))
        self._next = next(self._poses, None)
        if self._next is None:
            raise Refusal(f"{path} holds no poses of a tracker; name the log of a flight")
        self._first = self._next[0]
        self._began: float | None = None
        self._latest: dict[str, Body] = {}
        self._news = False

    def wait(self, until: float) -> bool:
        """Wait for bodies that came since the last `bodies`; False if none did by then."""
        if self._fast:
            self._take_each()
        else:
            self._take_due()
        if not self._news:
            time.sleep(max(0.0, min(until, self._due()) - time.monotonic()))
            self._take_due()
        return self._news

    def bodies(self) -> Mapping[str, Body]:
        """The latest of every body that was ever seen."""
        if not self._fast:
            self._take_due()
        self._news = False
        return dict(self._latest)

    def close(self) -> None:
        """Let go of the file."""
        self._poses.close()
        self._next = None

    def _due(self) -> float:
        """When the next pose comes, on the monotonic clock."""
        if self._next is None:
            return float("inf")
        if self._began is None:
            self._began = time.monotonic()
        return self._began + (self._next[0] - self._first) / 1e9

    def _take_due(self) -> None:
        while (due := self._due()) <= time.monotonic():
            self._take(due)

    def _take_each(self) -> None:
        taken, now = set(), time.monotonic()
        while self._next is not None and (name := self._next[1]) not in taken:
            taken.add(name)
            self._take(now)

    def _take(self, came: float) -> None:
        assert self._next is not None
        _, name, pose = self._next
        p, q = pose.position, pose.orientation
        before = self._latest.get(name)
        self._latest[name] = Body(
            (p.x, p.y, p.z), (q.x, q.y, q.z, q.w), came, before.number + 1 if before else 0
        )
        self._news = True
        try:
            self._next = next(self._poses, None)
        except Refusal:  # damaged: to whoever flies it, nobody is seen any more
            self._next = None


def _poses(path: Path) -> Generator[tuple[int, str, Any], None, None]:
    """When, in nanoseconds, which body was seen, and where."""
    for topic, when, data in bag.messages(path, lambda name: name.endswith(SEEN)):
        if topic.kind == flightlog.POSE:
            message = flightlog.parsed(path, topic, data)
            yield when, topic.name[1 : -len(SEEN)], message.pose
