"""Vicon Tracker's UDP object stream: a packet a frame, each object with its name and its pose.

Little-endian and packed: a frame number and the number of items, then for each item its kind, the
size of its data, a name padded with zeros, millimetres and radians. Several public parsers agree
on it; Vicon publishes no page of it.
"""

import socket
import struct
import threading
import time
from collections.abc import Collection, Mapping
from math import atan2, cos, hypot, sin

from skydog.errors import Refusal
from skydog.lab.adapters import Body, Quaternion, Vector

HEADER = struct.Struct("<IB")  # frame number, items
ITEM = struct.Struct("<BH24s6d")  # kind, size of the data, name, translation, rotation
DATA = ITEM.size - 3  # bytes that the size counts: the name and six numbers
OBJECT = 0  # the kind that has a pose
LONGEST = 24  # bytes of a name
BLOCKS = (256, 512, 1024)  # bytes to which Tracker pads a packet: 3, 6 and 13 objects
LARGEST = 2048  # bytes that are read of a packet
FURTHEST = 1e6  # mm, and rad: what is beyond is no pose
NUMBERS = 2**32  # frame numbers start again after so many
RESTART = 10  # frames in a row, 0.1 s at 100 Hz, that show that Tracker counts anew


def encode(number: int, bodies: Mapping[str, tuple[Vector, Quaternion]]) -> bytes:
    """The packet of a frame, padded as Tracker pads it. Positions in metres, unit quaternions."""
    packet = HEADER.pack(number % NUMBERS, min(len(bodies), 255))
    for name, (position, attitude) in bodies.items():
        millimetres = (1000.0 * along for along in position)
        packet += ITEM.pack(OBJECT, DATA, _encoded(name), *millimetres, *_angles(attitude))
    for size in BLOCKS:
        if len(packet) <= size:
            return packet.ljust(size, b"\0")
    most = (BLOCKS[-1] - HEADER.size) // ITEM.size
    raise Refusal(f"a packet of Vicon's holds {most} objects, not {len(bodies)}; track fewer")


def decode(packet: bytes) -> tuple[int, dict[str, tuple[Vector, Quaternion]]] | None:
    """The frame number, and the objects by name; None of bytes that are no such packet.

    Positions in metres. An item without a printable name or a finite pose is left out, of two with
    one name the first is kept, and of a packet that was cut the whole items are.
    """
    if len(packet) < HEADER.size:
        return None
    number, items = HEADER.unpack_from(packet)
    bodies: dict[str, tuple[Vector, Quaternion]] = {}
    at = HEADER.size
    for _ in range(items):
        if at + ITEM.size > len(packet):
            break
        kind, size, padded, *pose = ITEM.unpack_from(packet, at)
        if size < DATA or at + 3 + size > len(packet):
            break  # where the next one begins is not known
        at += 3 + size
        name = padded.split(b"\0", 1)[0].decode("ascii", "replace")
        if kind != OBJECT or not name or not (name.isascii() and name.isprintable()):
            continue
        if name not in bodies and all(abs(part) <= FURTHEST for part in pose):
            x, y, z, *angles = pose
            bodies[name] = (x / 1000.0, y / 1000.0, z / 1000.0), _attitude(*angles)
    if items and at == HEADER.size:
        return None
    return number, bodies


class Order:
    """Which frames are newer than all before, by a number of 32 bits that starts again at 0.

    A number that is not newer is late, or was sent twice. Ten late ones in a row, each newer than
    the one before, are a tracker that was restarted, or undo one number that was far ahead:
    late packets come singly, a restarted tracker goes on. No limit on how far back it went is
    needed, and poses are back as soon as a drone would be told to hold.
    """

    def __init__(self) -> None:
        self._latest: int | None = None
        self._before = 0  # the number that came last, accepted or not
        self._late = 0  # in a row

    def accepts(self, number: int) -> bool:
        """Whether to believe the frame of this number."""
        if self._latest is not None and not _newer(number, self._latest):
            if number == self._before:
                return False
            self._late = self._late + 1 if self._late and _newer(number, self._before) else 1
            self._before = number
            if self._late < RESTART:
                return False
        self._latest = self._before = number
        self._late = 0
        return True


class Receiver:
    """Bodies out of the packets that come to a UDP port: a `skydog.lab.adapters.Source`.

    A thread empties the socket, so what is shown never waited in a queue. Only bodies of the
    given names are kept, and a packet with none of them changes nothing.
    """

    def __init__(self, host: str, port: int, names: Collection[str]) -> None:
        """Listen at an address of ours; port 0 takes a free one."""
        self._names = frozenset(names)
        for name in self._names:
            _encoded(name)
        self.packets = 0  # that came
        self.bad = 0  # that are none of Tracker's
        self.late = 0  # that were not newer than one before
        self._order = Order()
        self._bodies: dict[str, Body] = {}
        self._fresh = False
        self._changed = threading.Condition()
        self._closed = threading.Event()
        self._socket = _bound(host, port)
        self.port: int = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._receive, name="vicon", daemon=True)
        self._thread.start()

    def wait(self, until: float) -> bool:
        """Wait for bodies that came since the last `bodies`; False if none did by then."""
        with self._changed:
            return self._changed.wait_for(lambda: self._fresh, max(0.0, until - time.monotonic()))

    def bodies(self) -> Mapping[str, Body]:
        """The latest of every body that was ever seen."""
        with self._changed:
            self._fresh = False
            return dict(self._bodies)

    def close(self) -> None:
        """Stop listening."""
        self._closed.set()
        self._thread.join()
        self._socket.close()

    def _receive(self) -> None:
        while not self._closed.is_set():
            try:
                packet = self._socket.recv(LARGEST)
            except TimeoutError:
                continue
            except OSError:  # some systems report a packet that is too long so
                self.bad += 1
                self._closed.wait(0.01)
                continue
            self._take(packet, time.monotonic())

    def _take(self, packet: bytes, now: float) -> None:
        self.packets += 1
        decoded = decode(packet)
        if decoded is None:
            self.bad += 1
            return
        number, bodies = decoded
        ours = {
            name: Body(*pose, now, number) for name, pose in bodies.items() if name in self._names
        }
        # A stranger's packet must not move the count of frames.
        if not ours:
            return
        if not self._order.accepts(number):
            self.late += 1
            return
        with self._changed:
            self._bodies.update(ours)
            self._fresh = True
            self._changed.notify_all()


def _bound(host: str, port: int) -> socket.socket:
    """A socket that listens. The address is not shared: a second listener would take packets."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        listening.bind((host, port))
    except (OSError, OverflowError, ValueError) as error:
        listening.close()
        reason = getattr(error, "strerror", None) or error
        raise Refusal(
            f"motion capture cannot be received at {host}:{port}: {reason}; stop what listens "
            "there, or write another mocap.host and mocap.port"
        ) from error
    listening.settimeout(0.1)  # s: a thread that waits for packets notices so soon that it is over
    return listening


def _newer(number: int, than: int) -> bool:
    return 0 < (number - than) % NUMBERS < NUMBERS // 2


def _encoded(name: str) -> bytes:
    if not name or len(name) > LONGEST or not (name.isascii() and name.isprintable()):
        raise Refusal(
            f"Vicon's stream cannot carry the name {name!r}; use 1 to {LONGEST} printable "
            "ASCII characters"
        )
    return name.encode("ascii")


def _attitude(x: float, y: float, z: float) -> Quaternion:
    """The unit quaternion of turns about x, then the new y, then the new z (intrinsic XYZ)."""
    a, b, c = cos(x / 2), cos(y / 2), cos(z / 2)
    d, e, f = sin(x / 2), sin(y / 2), sin(z / 2)
    return (
        d * b * c + a * e * f,
        a * e * c - d * b * f,
        a * b * f + d * e * c,
        a * b * c - d * e * f,
    )


def _angles(attitude: Quaternion) -> Vector:
    """The other way. The last turn is told by what the first leaves, so no attitude is special."""
    x, y, z, w = attitude
    # The rotation matrix, row by row; its second row ends in -f.
    a, b, c = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    d, e, f = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (w * x - y * z)
    g, h, i = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    first = atan2(f, i)
    level, across = cos(first), sin(first)
    last = atan2(level * d + across * g, level * e + across * h)
    return first, atan2(c, hypot(a, b)), last
