"""A rosbag2 folder of one MCAP file: written so that a crash costs little, read with bounds.

Each flush ends a chunk, so that a killed writer leaves whole chunks. Chunks are not compressed.
Format: https://mcap.dev/spec, and rosbag2's metadata.yaml of version 8.
"""

import fcntl
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BufferedReader, BytesIO, StringIO
from pathlib import Path
from typing import Any, NamedTuple

from skydog import files
from skydog.errors import Refusal

try:
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, Schema
    from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
    from ruamel.yaml import YAML
except ImportError:
    raise Refusal("a flight log needs mcap and rosbags; run: pip install 'skydog[lab]'") from None

METADATA = "metadata.yaml"
LARGEST = 4 << 30  # bytes of a file
LARGEST_RECORD = 1 << 24  # bytes; ours have about 100,000
MOST_TOPICS = 10_000

_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; data follow
_DAMAGED = (McapError, struct.error, ValueError, OverflowError)


class Topic(NamedTuple):
    """A topic of a bag, and how its messages are written."""

    name: str
    kind: str  # of its messages: std_msgs/msg/String
    definition: str  # of the kind, as .msg text
    digest: str  # of the kind, RIHS01; or ""


class Bag:
    """A bag that is being written. Every method may raise `OSError`."""

    def __init__(self, path: Path):
        self.path = path
        self._file = path.open("xb")
        fcntl.flock(self._file, fcntl.LOCK_EX)  # whoever would recover it meanwhile, sees it
        self._writer = Writer(self._file, compression=CompressionType.NONE)
        self._writer.start(profile="ros2", library="skydog")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._topics: list[Topic] = []
        self._counts: dict[str, int] = {}
        self._first, self._last = 0, 0

    def __contains__(self, name: str) -> bool:
        """Whether a topic was announced."""
        return name in self._channels

    def add(self, topic: Topic) -> None:
        """Announce a topic; one that is known stays as it is."""
        if topic.name in self:
            return
        if topic.kind not in self._schemas:
            self._schemas[topic.kind] = self._writer.register_schema(
                topic.kind, "ros2msg", topic.definition.encode()
            )
        self._channels[topic.name] = self._writer.register_channel(
            topic.name,
            "cdr",
            self._schemas[topic.kind],
            {"offered_qos_profiles": "", "topic_type_hash": topic.digest},
        )
        self._topics.append(topic)
        self._counts[topic.name] = 0

    def write(self, name: str, time: int, data: bytes) -> None:
        """Write a message, in CDR, of a topic that was announced. Nanoseconds of the epoch."""
        self._writer.add_message(self._channels[name], time, data, time)
        self._counts[name] += 1
        self._first = min(self._first or time, time)
        self._last = max(self._last, time)

    def flush(self) -> None:
        """Give all that was written to the operating system."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index, and all to the disk."""
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> None:
        """Let go of the file as it is."""
        with suppress(OSError):
            self._file.close()

    def metadata(self, name: str) -> str:
        """What metadata.yaml says when the MCAP file has a name."""
        start = {"nanoseconds_since_epoch": self._first}
        duration = {"nanoseconds": self._last - self._first}
        count = sum(self._counts.values())
        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": "",
                    "type_description_hash": topic.digest,
                },
                "message_count": self._counts[topic.name],
            }
            for topic in self._topics
        ]
        part = {
            "path": name,
            "starting_time": start,
            "duration": duration,
            "message_count": count,
        }
        information = {
            "version": 8,
            "storage_identifier": "mcap",
            "duration": duration,
            "starting_time": start,
            "message_count": count,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [name],
            "files": [part],
            "custom_data": None,
            "ros_distro": "skydog",
        }
        yaml, text = YAML(typ="safe"), StringIO()
        yaml.default_flow_style = False
        yaml.representer.ignore_aliases = lambda data: True
        yaml.dump({"rosbag2_bagfile_information": information}, text)
        return text.getvalue()


def find(path: Path) -> Path:
    """The MCAP file of a bag, given its folder or the file. Raises `Refusal` if there is none."""
    try:
        if files.is_folder(path):
            found = files.listed(path, "[!.]*.mcap")
            if len(found) != 1:
                raise Refusal(f"{path} holds {len(found)} .mcap files, not 1; name one")
            path = found[0]
        if not path.is_file():
            raise Refusal(f"{path} is no flight log: there is no such file; check the path")
        size = path.stat().st_size
    except OSError as problem:
        raise Refusal(f"cannot read {path}: {problem.strerror}; check the path") from None
    if size > LARGEST:
        raise Refusal(f"{path} has {size:,} bytes, more than any flight log ({LARGEST:,})")
    return path


def messages(
    path: Path, wanted: Callable[[str], bool] = lambda name: True
) -> Iterator[tuple[Topic, int, bytes]]:
    """The messages, in CDR, of the topics whose name is wanted, as they were written.

    What is damaged, compressed or in another encoding is left out, and so is all behind the place
    where the file breaks off. Raises `Refusal` for a file that is no MCAP at all.
    """
    schemas: dict[int, Schema] = {}
    topics: dict[int, Topic | None] = {}
    for kind, content in _unpacked(path):
        try:
            if kind == Opcode.MESSAGE:
                number, _, time, _ = _MESSAGE.unpack_from(content)
                if (topic := topics.get(number)) is not None:
                    yield topic, time, content[_MESSAGE.size :]
            elif kind == Opcode.SCHEMA:
                schema = Schema.read(_stream(content))
                schemas[schema.id] = schema
            elif kind == Opcode.CHANNEL:
                channel = Channel.read(_stream(content))
                schema = schemas.get(channel.schema_id)
                topics[channel.id] = _topic(channel, schema) if wanted(channel.topic) else None
        except _DAMAGED:
            continue
        if len(topics) > MOST_TOPICS or len(schemas) > MOST_TOPICS:
            raise Refusal(f"{path} has more than {MOST_TOPICS:,} topics; it is no flight log")


def recover(path: Path) -> None:
    """Make the log of a killed flight whole, so that other tools open it.

    What can be read of it is written anew, with an index and a metadata.yaml, and takes its place.
    A log that was closed keeps its file. Raises `Refusal` if there is nothing to be read, or no
    place to write.
    """
    file = find(path)
    partial = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        if _is_written(file):
            raise Refusal(f"{file} is being written; recover it when the flight is over")
        bag = Bag(partial)
        try:
            count = 0
            for topic, time, data in messages(file):
                bag.add(topic)
                bag.write(topic.name, time, data)
                count += 1
            if not count:
                raise Refusal(f"{file} holds no whole message; there is nothing to recover")
            bag.close()
        finally:
            bag.abandon()
        if not _closed(file):
            os.replace(partial, file)
    except OSError as problem:
        raise Refusal(f"cannot recover {file}: {problem.strerror}; make room for it") from None
    finally:
        partial.unlink(missing_ok=True)
    files.write_text(file.with_name(METADATA), bag.metadata(file.name))


def _is_written(path: Path) -> bool:
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def _closed(path: Path) -> bool:
    """Whether its writer came to the end of the file."""
    with path.open("rb") as file:
        file.seek(-len(MCAP0_MAGIC), os.SEEK_END)
        return file.read() == MCAP0_MAGIC


def _topic(channel: Channel, schema: Schema | None) -> Topic | None:
    if schema is None or (channel.message_encoding, schema.encoding) != ("cdr", "ros2msg"):
        return None
    digest = channel.metadata.get("topic_type_hash", "")
    return Topic(channel.topic, schema.name, schema.data.decode(), digest)


def _unpacked(path: Path) -> Iterator[tuple[int, bytes]]:
    """The records of a file, those of whole chunks among them."""
    try:
        with path.open("rb") as file:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise Refusal(f"{path} is damaged or no flight log: it does not begin as an MCAP")
            for kind, content in _records(file):
                if kind == Opcode.CHUNK:
                    yield from _records(BytesIO(_chunk(content)))
                elif kind == Opcode.DATA_END:
                    return
                else:
                    yield kind, content
    except OSError as problem:
        raise Refusal(f"cannot read {path}: {problem.strerror}; check the path") from None


def _records(stream: BufferedReader | BytesIO) -> Iterator[tuple[int, bytes]]:
    """The records up to the first that is not whole."""
    while len(head := stream.read(9)) == 9:
        kind, size = struct.unpack("<BQ", head)
        if size > LARGEST_RECORD or len(content := stream.read(size)) < size:
            return
        yield kind, content


def _chunk(content: bytes) -> bytes:
    """The records in a chunk, if it is whole."""
    try:
        chunk = Chunk.read(_stream(content))
    except _DAMAGED:
        return b""
    whole = chunk.uncompressed_crc in (0, zlib.crc32(chunk.data))
    return chunk.data if whole and not chunk.compression else b""


def _stream(content: bytes) -> Any:
    return ReadDataStream(BytesIO(content))
