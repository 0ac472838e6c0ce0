"""Tracks: where sheep and dogs were, measured by somebody, read from a file.

A CSV file has the columns `time` (s), `kind` (sheep or dog), `id`, `x`, `y` (m), and `event` if
there are several. The open data of Jadhav et al. 2024 is read as its authors publish it.
"""

import csv
import io
import math
import struct
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy import io as matlab

from skydog import files
from skydog.errors import Refusal, short
from skydog.world import trace as traces
from skydog.world.trace import Trace

LARGEST = 1 << 28  # bytes of a file, and of what is packed in it
FARTHEST = 1e6  # metres and seconds
COLUMNS = ("time", "kind", "id", "x", "y")
KINDS = ("sheep", "dog")
FOLDS = 3  # fewer events than this are cut

# Jadhav et al. 2024, github.com/tee-lab/collective-responses-of-flocking-sheep-to-herding-dog:
# of 16 tags 14 are on sheep, the next is on the dog, and the last on the human shepherd.
JADHAV_SHEEP, JADHAV_DOG, JADHAV_TAGS = 14, 15, 16


@dataclass(frozen=True)
class Piece:
    """Positions without a gap. Seconds, and metres: shapes (instants, sheep or dogs, 2)."""

    time: Float[np.ndarray, " instants"]
    sheep: Float[np.ndarray, "instants sheep 2"]
    dogs: Float[np.ndarray, "instants dogs 2"]


@dataclass(frozen=True)
class Event:
    """What was measured on one occasion, such as a trial: pieces with gaps between them."""

    name: str
    pieces: list[Piece]


@dataclass(frozen=True)
class Windows:
    """Equal stretches of tracks: positions at `length` instants, a step apart, and of which event.

    Metres: shapes (windows, length, sheep or dogs, 2).
    """

    sheep: Float[np.ndarray, "windows length sheep 2"]
    dogs: Float[np.ndarray, "windows length dogs 2"]
    event: Int[np.ndarray, " windows"]


def read(path: Path) -> list[Event]:
    """The events of a file of tracks, each with the same number of sheep and of dogs.

    `.csv` is the layout of this module. `.dat` is `sheepR.dat` of Jadhav et al. 2024, whose
    events are trials; `.mat` their `drives_data.mat`, whose pieces are drives, or
    `sheep_all_dat.mat`. Raises `Refusal` for what is none of these.
    """
    path = Path(path)
    readers = {".csv": _read_csv, ".dat": _read_dat, ".mat": _read_mat}
    if path.suffix.lower() not in readers:
        raise Refusal(f"{path} is no file of tracks: its name ends in .csv, .dat or .mat")
    events = readers[path.suffix.lower()](path, files.read_bytes(path, "file of tracks", LARGEST))
    events = [event for event in events if event.pieces]
    if not events:
        raise Refusal(f"{path} has no two instants in a row at which everyone was seen")
    first = events[0].pieces[0]
    for event in events:
        for piece in event.pieces:
            for who in ("sheep", "dogs"):
                count, expected = getattr(piece, who).shape[1], getattr(first, who).shape[1]
                if count != expected:
                    raise Refusal(
                        f"{path} has {count} {who} in the event {event.name!r:.60}, and "
                        f"{expected} in the first; give one flock a file"
                    )
    return events


def of_trace(name: str, trace: Trace) -> Event:
    """What one mission recorded, until it was accomplished, as an event."""
    seen = traces.frames(trace)
    until = traces.last_instant(seen) + 1
    parts = (np.asarray(part[:until], float) for part in (seen.time, seen.sheep, seen.dogs))
    return Event(name, [Piece(*parts)])


def write(path: Path, events: list[Event]) -> None:
    """Write tracks in the CSV layout of this module."""
    lines = ["event,time,kind,id,x,y\n"]
    for event in events:
        for piece in event.pieces:
            for row, time in enumerate(piece.time):
                for kind, places in zip(KINDS, (piece.sheep, piece.dogs), strict=True):
                    lines += [
                        f"{event.name},{time:.9g},{kind},{number},{x:.7g},{y:.7g}\n"
                        for number, (x, y) in enumerate(places[row].tolist(), 1)
                    ]
    files.write_text(path, "".join(lines))


def interval(events: list[Event]) -> float:
    """The seconds between two instants, in the median."""
    return float(np.median(np.concatenate([np.diff(p.time) for e in events for p in e.pieces])))


def parts(events: list[Event]) -> list[Event]:
    """At least `FOLDS` events: where there are fewer, each piece is one, or is cut by time."""
    if len(events) >= FOLDS:
        return events
    pieces = [piece for event in events for piece in event.pieces]
    if len(pieces) < FOLDS:
        pieces = [
            Piece(piece.time[rows], piece.sheep[rows], piece.dogs[rows])
            for piece in pieces
            for rows in np.array_split(np.arange(len(piece.time)), 2 * FOLDS)
            if len(rows) > 1
        ]
    return [Event(str(number), [piece]) for number, piece in enumerate(pieces, 1)]


def windows(events: list[Event], step: float, length: int) -> Windows:
    """All stretches of `length` instants, `step` seconds apart, one from each instant on.

    Between two instants that were measured, positions are interpolated. Raises `Refusal` for
    tracks that are too short.
    """
    sheep, dogs, event = [], [], []
    for number, each in enumerate(events):
        for piece in each.pieces:
            count = int((piece.time[-1] - piece.time[0]) / step + 1e-6) + 1
            at = piece.time[0] + step * np.arange(count)
            first = np.arange(count - length + 1)[:, None] + np.arange(length)
            sheep.append(_at(piece.time, piece.sheep, at)[first])
            dogs.append(_at(piece.time, piece.dogs, at)[first])
            event += [number] * len(first)
    if not event:
        raise Refusal(
            f"these tracks have no stretch of {length} instants {step:g} s apart; "
            "try a shorter --step, or longer tracks"
        )
    return Windows(np.concatenate(sheep), np.concatenate(dogs), np.array(event, int))


def _at(time: np.ndarray, places: np.ndarray, at: np.ndarray) -> np.ndarray:
    flat = places.reshape(len(time), -1)
    found = np.stack([np.interp(at, time, column) for column in flat.T], axis=-1)
    return found.reshape(len(at), *places.shape[1:])


def _read_csv(path: Path, content: bytes) -> list[Event]:
    try:
        lines = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""))
        head = [name.strip().lower() for name in next(lines, [])]
    except (UnicodeDecodeError, csv.Error):
        raise Refusal(f"{path} is no CSV file in UTF-8") from None
    missing = [name for name in COLUMNS if head.count(name) != 1]
    if missing:
        raise Refusal(
            f"{path} has no column {missing[0]!r}; its first line names the columns: "
            f"{','.join(COLUMNS)}, and event"
        )
    return _events(path, _csv_rows(path, lines, head))


Row = tuple[str, str, str, float, float, float]
"""Event, kind, id, time, x, y."""


def _csv_rows(path: Path, lines: Any, head: list[str]) -> Iterator[Row]:
    at = {name: head.index(name) for name in head}
    try:
        for line in lines:
            if not line:
                continue
            if len(line) != len(head):
                raise Refusal(
                    f"{path}, line {lines.line_num}: {len(line)} columns, not {len(head)}"
                )
            kind = line[at["kind"]].strip().lower()
            if kind not in KINDS:
                raise Refusal(
                    f"{path}, line {lines.line_num}: {short(kind)} is no kind; write sheep or dog"
                )
            event = line[at["event"]].strip() if "event" in at else "1"
            time, x, y = (
                _number(path, lines.line_num, line[at[name]]) for name in ("time", "x", "y")
            )
            yield event, kind, line[at["id"]].strip(), time, x, y
    except csv.Error as problem:
        raise Refusal(f"{path}, line {lines.line_num}: {problem}") from None


def _read_dat(path: Path, content: bytes) -> list[Event]:
    """`sheepR.dat`: trial, tag, time (s), x, y (m), with or without a line of names."""

    def rows() -> Iterator[Row]:
        for number, line in enumerate(io.StringIO(content.decode("latin-1")), 1):
            values = line.replace(",", " ").replace(";", " ").replace('"', " ").split()
            if not values or (number == 1 and not values[0].replace(".", "").isdigit()):
                continue
            if len(values) != 5:
                raise Refusal(
                    f"{path}, line {number}: {len(values)} columns, where sheepR.dat has trial, "
                    "tag, time, x and y"
                )
            trial, tag, time, x, y = (_number(path, number, value) for value in values)
            if not (tag.is_integer() and 1 <= tag <= JADHAV_TAGS):
                raise Refusal(f"{path}, line {number}: no tag has the number {tag:g}")
            if tag <= JADHAV_DOG:
                kind = "sheep" if tag <= JADHAV_SHEEP else "dog"
                yield f"{trial:g}", kind, f"{tag:g}", time, x, y

    return _events(path, rows())


def _read_mat(path: Path, content: bytes) -> list[Event]:
    """`drives_data.mat`, in which a trial's drives follow each other, or `sheep_all_dat.mat`."""
    _refuse_bomb(path, content)
    try:
        found = matlab.loadmat(io.BytesIO(content))
        step = float(found["dt"].item())
        trials = [int(trial) for trial in np.ravel(found.get("events", []))]
        whole = trials or list(range(1, int(found["no_evnts"].item()) + 1))
        events = []
        for place, trial in enumerate(whole, 1):
            positions = np.asarray(found[f"pos_ev_{place}"], float)
            if positions.shape[:2] != (JADHAV_TAGS, 2) or positions.ndim != 3:
                raise ValueError(f"pos_ev_{place} has the shape {positions.shape}")
            lengths = [positions.shape[2]]
            if trials:
                first, last = (np.ravel(found[f"ev_{end}_{trial}"]) for end in ("st", "et"))
                lengths = [round(length) + 1 for length in (last - first).tolist()]
            if sum(lengths) != positions.shape[2] or min(lengths) < 1:
                raise ValueError(f"the drives of trial {trial} are not as long as pos_ev_{place}")
            ends = np.cumsum(lengths)
            pieces = []
            for part in np.split(np.moveaxis(positions, -1, 0), ends[:-1]):
                time = step * np.arange(len(part))
                pieces += _pieces(time, part[:, :JADHAV_SHEEP], part[:, JADHAV_DOG - 1][:, None])
            events.append(Event(str(trial), pieces))
        return events
    except Exception as problem:  # whatever a reader of a binary format may raise
        said = f"{type(problem).__name__}: {problem}".split("\n")[0]
        raise Refusal(
            f"{path} is no drives_data.mat or sheep_all_dat.mat of Jadhav et al. 2024 "
            f"({said:.120}); try their sheepR.dat"
        ) from None


def _refuse_bomb(path: Path, content: bytes) -> None:
    """Raise `Refusal` for a file whose packed parts are larger than any file may be."""
    at, left = 128, LARGEST
    while at + 8 <= len(content):
        kind, size = struct.unpack_from("<II", content, at)
        if kind == 15:  # a packed element
            try:
                left -= len(zlib.decompressobj().decompress(content[at + 8 : at + 8 + size], left))
            except zlib.error:
                raise Refusal(f"{path} is damaged; get it again") from None
        if left <= 0:
            raise Refusal(f"{path} holds more than {LARGEST:,} bytes, more than any file of tracks")
        at += 8 + size


def _number(path: Path, line: int, text: str) -> float:
    """A number of a file; NaN is a position that was not measured."""
    try:
        number = math.nan if text.strip().lower() in ("", "na", "nan") else float(text)
    except ValueError:
        number = math.inf
    if math.isinf(number) or abs(number) > FARTHEST:
        raise Refusal(f"{path}, line {line}: {short(text)} is no number up to {FARTHEST:,.0f}")
    return number


def _events(path: Path, rows: Iterator[Row]) -> list[Event]:
    """The events of rows in any order."""
    events: dict[str, int] = {}
    who: dict[tuple[int, str, str], int] = {}
    columns = [array("d") for _ in range(5)]  # floats hold every whole number up to 2^53
    for event, kind, name, time, x, y in rows:
        number = events.setdefault(event, len(events))
        animal = who.setdefault((number, kind, name), len(who))
        for column, value in zip(columns, (number, animal, time, x, y), strict=True):
            column.append(value)
    event_of, animal_of, time, x, y = (np.asarray(column) for column in columns)
    animal_of = animal_of.astype(int)
    found = []
    for name, number in events.items():
        mine = (event_of == number) & np.isfinite(time)
        animals = {
            kind: [at for key, at in who.items() if key[:2] == (number, kind)] for kind in KINDS
        }
        for kind, numbers in animals.items():
            if not numbers:
                raise Refusal(f"{path} has no {kind} in the event {name!r:.60}")
        order = animals["sheep"] + animals["dog"]
        # To the millisecond: what was written at one time was measured at one time.
        times, row = np.unique(np.rint(1e3 * time[mine]), return_inverse=True)
        column = np.searchsorted(np.sort(order), animal_of[mine])
        if len(times) * len(order) > LARGEST:
            raise Refusal(f"{path} has too many times and animals in the event {name!r:.60}")
        cell = row * len(order) + column
        if len(np.unique(cell)) != len(cell):
            raise Refusal(f"{path} has an animal twice at one time in the event {name!r:.60}")
        places = np.full((len(times) * len(order), 2), np.nan)
        places[cell] = np.stack([x[mine], y[mine]], axis=-1)
        places = places.reshape(len(times), len(order), 2)[:, np.argsort(np.argsort(order))]
        sheep = len(animals["sheep"])
        found.append(Event(name, _pieces(times / 1e3, places[:, :sheep], places[:, sheep:])))
    return found


def _pieces(time: np.ndarray, sheep: np.ndarray, dogs: np.ndarray) -> list[Piece]:
    """The stretches in which everyone was seen, cut where a time is missing."""
    seen = np.isfinite(sheep).all(axis=(1, 2)) & np.isfinite(dogs).all(axis=(1, 2))
    if seen.sum() < 2:
        return []
    time, sheep, dogs = time[seen], sheep[seen], dogs[seen]
    if max(np.abs(sheep).max(), np.abs(dogs).max()) > FARTHEST:
        raise ValueError(f"a position is further than {FARTHEST:,.0f} m")
    gaps = np.diff(time)
    cuts = np.flatnonzero(gaps > 1.5 * np.median(gaps)) + 1
    every = zip(*(np.split(values, cuts) for values in (time, sheep, dogs)), strict=True)
    return [Piece(*one) for one in every if len(one[0]) > 1]
