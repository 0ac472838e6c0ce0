"""The flight log: everything that a flight was, as a rosbag2 folder that Foxglove opens too.

The loop only puts what it knows on a queue; a thread of its own writes. A killed flight loses at
most its last second.
"""

import json
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from skydog import files
from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab import bag
from skydog.lab.adapters import Quaternion, Vector
from skydog.lab.bag import METADATA, Bag, Topic, recover
from skydog.lab.messages import store2
from skydog.world import serialise
from skydog.world import trace as traces
from skydog.world.params import World
from skydog.world.trace import ENDINGS, Poses, Trace

__all__ = ["Decision", "Flight", "FlightLog", "Timing", "load", "parsed", "recover"]

LONGEST_QUEUE = 20_000  # messages; about ten seconds of a flight with four robots
PERIOD = 0.02  # s between two looks at the queue: each holds the interpreter for under 1 ms
FLUSH = 0.5  # s
WORLD, TRACKER = "world", "tracker"  # frames

HEADER = "std_msgs/msg/Header"
POSE = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
STRING = "std_msgs/msg/String"
LOG = "rcl_interfaces/msg/Log"
DECISION = "skydog_msgs/msg/Decision"
ENDING = "skydog_msgs/msg/Ending"
SUPERVISOR = "skydog_msgs/msg/Supervisor"
TIMING = "skydog_msgs/msg/Timing"


class Flight(NamedTuple):
    """What is flown: who steers, in which world, whom, and for how many steps at most."""

    shepherd: str
    world: World
    dogs: tuple[str, ...]
    sheep: tuple[str, ...]
    steps: int


class Decision(NamedTuple):
    """An instant of a mission, as `Trace` and its `Poses` have it, and the force on each sheep.

    World frame, metres, radians, m/s. The last instant commands nothing.
    """

    case: int
    step: int
    sheep: Float[np.ndarray, "sheep 2"]
    dogs: Float[np.ndarray, "dogs 2"]
    subgoal: Float[np.ndarray, "dogs 2"]
    drives: Bool[np.ndarray, " dogs"]
    command: Float[np.ndarray, "dogs 2"]
    force: Float[np.ndarray, "sheep 2"]
    accomplished: bool
    altitude: Float[np.ndarray, " dogs"]
    attitude: Float[np.ndarray, "dogs 3"]
    setpoint: Float[np.ndarray, "dogs 3"]
    yaw: Float[np.ndarray, " sheep"]
    speed: Float[np.ndarray, " sheep"]
    turn_rate: Float[np.ndarray, " sheep"]


class Timing(NamedTuple):
    """How well the loop keeps its time. Seconds."""

    pose_ages: Float[np.ndarray, " robots"]  # of the latest that were believed, drones first
    jitter: float  # by which this tick came late
    decide: float  # that the latest decision took
    latency: float  # from the newest pose to the commands
    missed: int  # deadlines, since the start


class FlightLog:
    """The log of a flight, in a folder that it makes.

    Its methods never block and never raise; what they are given is written later, and is not to
    be changed meanwhile. Times are of the monotonic clock. `problem` is why nothing more is
    written, a full disk say, and `dropped` how many messages were lost. Raises `Refusal` if the
    folder is there already or cannot be written.
    """

    def __init__(self, folder: Path, site_text: str, card: dict[str, Any], flight: Flight):
        self.problem: str | None = None
        self.dropped = 0
        self._folder = folder
        self._dogs = flight.dogs
        self._epoch = time.time_ns() - time.monotonic_ns()
        self._queue: deque[tuple[Callable[..., None], float, tuple[Any, ...]]] = deque()
        self._closing = threading.Event()
        self._store = store2()
        self._types: Any = self._store.types
        path = folder / f"{folder.name}_0.mcap"
        if folder.exists():
            raise Refusal(f"{folder} is there already; choose another folder for the log")
        files.folder(folder)
        try:
            self._bag = Bag(path)
            try:
                self._begin(site_text, card, flight)
            except (OSError, Refusal):
                self._bag.abandon()
                raise
        except OSError as problem:
            raise Refusal(f"cannot write {path}: {problem.strerror}; make room for it") from None
        self._thread = threading.Thread(target=self._run, name="flight log", daemon=True)
        self._thread.start()

    def pose(self, name: str, position: Vector, attitude: Quaternion, t: float) -> None:
        """Where a body is believed to be, in the world."""
        self._put(self._write_pose, t, f"/{name}/pose", WORLD, position, attitude)

    def seen(self, name: str, position: Vector, attitude: Quaternion, t: float) -> None:
        """Where the tracker saw a body, in the tracker's frame."""
        self._put(self._write_pose, t, f"/{name}/seen", TRACKER, position, attitude)

    def command(self, name: str, linear: Vector, angular: Vector, t: float) -> None:
        """What a robot was told: m/s and rad/s; of a drone in the world, of a rover in its own."""
        frame = WORLD if name in self._dogs else name
        self._put(self._write_command, t, f"/{name}/cmd", frame, linear, angular)

    def decision(self, decision: Decision, t: float) -> None:
        """An instant of a mission."""
        self._put(self._write_decision, t, decision)

    def ended(self, case: int, how: str, steps: int, t: float) -> None:
        """How a mission ended: one of `ENDINGS`, and after how many steps time would be up."""
        self._put(self._write_fields, t, "/ending", ENDING, (case, how, steps))

    def transition(self, mode: Mode, event: str, reason: str, t: float) -> None:
        """The supervisor went into a mode."""
        self._put(self._write_fields, t, "/supervisor", SUPERVISOR, (int(mode), event, reason))

    def timing(self, timing: Timing, t: float) -> None:
        """How well the loop keeps its time."""
        ages = np.asarray(timing.pose_ages, np.float32)
        self._put(self._write_fields, t, "/timing", TIMING, (ages, *timing[1:]))

    def event(self, text: str) -> None:
        """Something that a reader of the log is to know; it happens now."""
        self._put(self._write_event, time.monotonic(), text)

    def close(self) -> None:
        """Write what is left, the index and metadata.yaml. May be called twice."""
        self._closing.set()
        self._thread.join()

    def _put(self, write: Callable[..., None], t: float, *what: Any) -> None:
        if self.problem is not None or len(self._queue) >= LONGEST_QUEUE:
            self.dropped += 1
        else:
            self._queue.append((write, t, what))

    def _begin(self, site_text: str, card: dict[str, Any], flight: Flight) -> None:
        for kind in (POSE, TWIST, LOG, DECISION, ENDING, SUPERVISOR, TIMING):
            self._store.get_msgdef(kind)  # compiled now: it holds the interpreter for long
        mission = {
            "shepherd": flight.shepherd,
            "world": serialise.flatten(flight.world, len(flight.sheep)),
            "dogs": flight.dogs,
            "sheep": flight.sheep,
            "steps": flight.steps,
        }
        now, string = time.monotonic(), self._types[STRING]
        self._write(now, "/site", STRING, string(site_text))
        self._write(now, "/sheepdog", STRING, string(json.dumps(files.plain(card))))
        self._write(now, "/mission", STRING, string(json.dumps(files.plain(mission))))
        self._bag.flush()
        self._describe()

    def _run(self) -> None:
        try:
            due = time.monotonic() + FLUSH
            while not self._closing.wait(PERIOD):
                self._write_queue()
                if time.monotonic() >= due:
                    self._bag.flush()
                    due = time.monotonic() + FLUSH
            self._write_queue()
            if self.dropped:
                self._write_event(time.monotonic(), f"{self.dropped} messages were dropped")
            self._bag.close()
            self._describe()
        except Exception as problem:  # whatever it is: the flight goes on without a log
            why = getattr(problem, "strerror", None) or problem
            self.problem = f"the flight log ends here, cannot write {self._bag.path}: {why}"
            self._bag.abandon()
            self._queue.clear()

    def _describe(self) -> None:
        files.write_text(self._folder / METADATA, self._bag.metadata(self._bag.path.name))

    def _write_queue(self) -> None:
        for _ in range(len(self._queue)):
            write, t, what = self._queue.popleft()
            write(t, *what)

    def _write_pose(
        self, t: float, topic: str, frame: str, position: Vector, attitude: Quaternion
    ) -> None:
        point = self._types["geometry_msgs/msg/Point"](*map(float, position))
        turn = self._types["geometry_msgs/msg/Quaternion"](*map(float, attitude))
        pose = self._types["geometry_msgs/msg/Pose"](point, turn)
        self._write(t, topic, POSE, self._types[POSE](self._header(t, frame), pose))

    def _write_command(
        self, t: float, topic: str, frame: str, linear: Vector, angular: Vector
    ) -> None:
        vector = self._types["geometry_msgs/msg/Vector3"]
        twist = self._types["geometry_msgs/msg/Twist"](
            vector(*map(float, linear)), vector(*map(float, angular))
        )
        self._write(t, topic, TWIST, self._types[TWIST](self._header(t, frame), twist))

    def _write_decision(self, t: float, decision: Decision) -> None:
        rows = {
            name: np.ravel(value).astype(bool if name == "drives" else np.float32)
            for name, value in decision._asdict().items()
            if name not in ("case", "step", "accomplished")
        }
        message = self._types[DECISION](
            header=self._header(t, WORLD),
            case_number=int(decision.case),
            step=int(decision.step),
            accomplished=bool(decision.accomplished),
            **rows,
        )
        self._write(t, "/decision", DECISION, message)

    def _write_fields(self, t: float, topic: str, kind: str, values: tuple[Any, ...]) -> None:
        self._write(t, topic, kind, self._types[kind](self._header(t, WORLD), *values))

    def _write_event(self, t: float, text: str) -> None:
        log = self._types[LOG]
        stamp = self._header(t, "").stamp
        self._write(t, "/events", LOG, log(stamp, log.INFO, "skydog", text, "", "", 0))

    def _header(self, t: float, frame: str) -> Any:
        seconds, rest = divmod(self._clock(t), 1_000_000_000)
        return self._types[HEADER](self._types["builtin_interfaces/msg/Time"](seconds, rest), frame)

    def _clock(self, t: float) -> int:
        """The nanoseconds of the epoch at a time of the monotonic clock."""
        return self._epoch + round(t * 1e9)

    def _write(self, t: float, topic: str, kind: str, message: Any) -> None:
        if topic not in self._bag:
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            self._bag.add(Topic(topic, kind, definition, self._store.hash_rihs01(kind)))
        self._bag.write(topic, self._clock(t), bytes(self._store.serialize_cdr(message, kind)))


def load(path: Path, case: int | None = None) -> tuple[Trace, str]:
    """Read the mission of a log, given its folder or its .mcap, and who flew it.

    Of a log with several cases it is the last, unless one is named. A mission whose log breaks
    off was stopped by the supervisor. Raises `Refusal` for a file that is no log of a mission.
    """
    file = bag.find(path)
    mission: dict[str, Any] = {}
    decisions: dict[int, list[Any]] = {}
    endings: dict[int, Any] = {}
    size = 0
    for kind, message, length in _messages(file):
        size += length + 1000  # about what the objects of a message take
        if size > traces.LARGEST:
            raise Refusal(f"{file} holds more than a trace may ({traces.LARGEST:,} bytes)")
        if kind == STRING:
            mission = _json(message.data)
        elif kind == DECISION:
            decisions.setdefault(message.case_number, []).append(message)
        else:
            endings[message.case_number] = message
    if case is None:
        case = next(reversed(decisions), 0)
    if case not in decisions or not isinstance(mission.get("world"), dict):
        raise Refusal(f"{file} holds no mission: no world or no decision of case {case}")
    found, world = decisions[case], serialise.unflatten(mission["world"])
    names = {name: mission.get(name) for name in ("dogs", "sheep")}
    numbers = {name: len(of) if isinstance(of, list) else 0 for name, of in names.items()}
    rows = {name: _rows(file, found, name, numbers) for name in _SHAPES}
    steps = np.array([one.step for one in found])
    if np.any(np.diff(steps) <= 0) or steps[-1] > traces.LONGEST:
        raise Refusal(f"{file} is not a full log: its decisions are out of order")
    accomplished = np.array([one.accomplished for one in found])
    trace = Trace(
        world=world,
        time=jnp.asarray(steps.astype(np.float32) * np.float32(world.arena.dt)),
        accomplished=jnp.asarray(accomplished),
        ending=_ending(file, mission, endings.get(case), bool(accomplished.any()), int(steps[-1])),
        poses=Poses(**{name: rows.pop(name) for name in _POSES}),
        **rows,
    )
    return trace, str(mission.get("shepherd", "unknown"))


# The rows of a decision that a trace keeps: whose they are, and the numbers of each.
_POSES = {
    "altitude": ("dogs",),
    "attitude": ("dogs", 3),
    "setpoint": ("dogs", 3),
    "yaw": ("sheep",),
    "speed": ("sheep",),
    "turn_rate": ("sheep",),
}
_SHAPES: dict[str, tuple[str | int, ...]] = {
    "sheep": ("sheep", 2),
    "dogs": ("dogs", 2),
    "subgoal": ("dogs", 2),
    "drives": ("dogs",),
    "command": ("dogs", 2),
    **_POSES,
}
_READ = {"/mission": STRING, "/decision": DECISION, "/ending": ENDING}


def _messages(path: Path) -> Iterator[tuple[str, Any, int]]:
    """What a mission is read from: the kind of each message, itself, and its size in bytes."""
    for topic, _, data in bag.messages(path, _READ.__contains__):
        if topic.kind == _READ[topic.name]:
            yield topic.kind, parsed(path, topic, data), len(data)


def parsed(path: Path, topic: Topic, data: bytes) -> Any:
    """A message of a log as an object. Raises `Refusal` if it is none of its kind."""
    from rosbags.serde import SerdeError

    try:
        return store2().deserialize_cdr(data, topic.kind)
    except (SerdeError, struct.error, ValueError, IndexError):
        raise Refusal(f"{path} is damaged: a message of {topic.name} is misshapen") from None


def _json(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        found = None
    return found if isinstance(found, dict) else {}


def _rows(path: Path, found: list[Any], name: str, numbers: dict[str, int]) -> Any:
    """A part of a trace: an array with a row for each decision."""
    shape = [numbers[size] if isinstance(size, str) else size for size in _SHAPES[name]]
    rows = [getattr(one, name) for one in found]
    if any(len(row) != np.prod(shape) for row in rows) or 0 in shape:
        raise Refusal(f"{path} is not a full log: {name} is not of {numbers}")
    rows = np.stack(rows).reshape(len(rows), *shape)
    if not np.all(np.abs(rows) <= serialise.LARGEST):
        raise Refusal(f"{path} is not a full log: {name} is out of bounds")
    return jnp.asarray(rows)


def _ending(
    path: Path, mission: dict[str, Any], said: Any, accomplished: bool, last: int
) -> traces.Ending:
    how = said.how if said else ENDINGS[traces.ACCOMPLISHED] if accomplished else ENDINGS[-1]
    steps = said.steps if said else mission.get("steps")
    if how not in ENDINGS or type(steps) is not int or not last <= steps <= traces.LONGEST:
        raise Refusal(f"{path} is not a full log: it ended {how!r:.60} of {steps!r:.60} steps")
    return traces.Ending(how=jnp.asarray(ENDINGS.index(how)), steps=jnp.asarray(steps))
