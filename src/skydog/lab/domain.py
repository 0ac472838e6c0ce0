"""ROS 2's topics without ROS 2: a participant of DDS, its publishers and subscriptions.

A ROS 2 topic /NAME/cmd_vel of geometry_msgs/msg/Twist is the DDS topic rt/NAME/cmd_vel of the type
geometry_msgs::msg::dds_::Twist_, in the CDR that `skydog.lab.messages` makes. Quality of service
is ROS 2's default: reliable, volatile, keep last. Who only listens asks for best effort,
which matches every publisher.
"""

import time
from collections.abc import Sequence
from contextlib import suppress
from threading import Lock
from typing import Any
from xml.sax.saxutils import quoteattr

from skydog.errors import Refusal
from skydog.lab import messages
from skydog.lab.site import DDS

try:
    from cyclonedds import builtin
    from cyclonedds.core import (
        DDSException,
        Entity,
        InstanceState,
        Policy,
        Qos,
        ReadCondition,
        SampleState,
        ViewState,
        WaitSet,
    )
    from cyclonedds.domain import Domain as Wire
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
except ImportError as missing:
    raise Refusal("ROS 2's wire needs cyclonedds; run: pip install 'skydog[lab]'") from missing

DEPTH = 10  # messages that wait to be taken: ROS 2's default
LARGEST = 16384  # bytes of a message; a longer one is dropped before Python sees it
MOST_ENDPOINTS = 1000  # publishers and participants that `others` looks at

_wires: dict[int, tuple[str, Wire, set[Any]]] = {}  # by domain: configuration, wire, users
_lock = Lock()


def mangled(topic: str) -> str:
    """What DDS calls a ROS 2 topic."""
    return "rt/" + topic.strip("/")


def beside(topic: str, name: str) -> str:
    """The topic `name` in the same namespace as `topic`."""
    return topic.rpartition("/")[0] + "/" + name


class Domain:
    """One participant in a DDS domain, as a site describes it: unicast to its peers alone.

    Raises Refusal when DDS cannot open the interface, or when this process has the domain open
    with another interface or other peers.
    """

    def __init__(self, site: DDS):
        self._number = site.domain
        self._entities: list[Entity] = []
        _open(site, self)
        try:
            self._participant = self._kept(DomainParticipant(site.domain))
            self._publications = self._kept(
                builtin.BuiltinDataReader(self._participant, builtin.BuiltinTopicDcpsPublication)
            )
            self._participants = self._kept(
                builtin.BuiltinDataReader(self._participant, builtin.BuiltinTopicDcpsParticipant)
            )
            alive = ViewState.Any | SampleState.Any | InstanceState.Alive
            self._living = self._kept(ReadCondition(self._publications, alive))
        except DDSException as error:
            self.close()
            raise Refusal(f"DDS domain {site.domain} cannot be joined ({error})") from error

    def publish(self, topic: str, name: str) -> "Publisher":
        """A publisher of messages called `name` (package/msg/Name) on a ROS 2 topic."""
        return self.write(mangled(topic), messages.idl(name))

    def write(self, topic: str, kind: type[Any]) -> "Publisher":
        """A publisher on a DDS topic, by its own name there, of a class of cyclonedds."""
        try:
            about = Topic(self._participant, topic, kind)
            # Depth 1, 0 s: the newest counts, and a slow listener never makes us wait.
            quality = _quality(Policy.Reliability.Reliable(0), 1)
            return Publisher(self._kept(DataWriter(self._participant, about, quality)), kind)
        except DDSException as error:
            raise Refusal(f"DDS has no topic {topic!r}: {error}") from error

    def subscribe(self, topic: str, name: str, reliable: bool = False) -> "Subscription":
        """A subscription to messages called `name` on a ROS 2 topic."""
        return self.read(mangled(topic), messages.idl(name), reliable)

    def read(self, topic: str, kind: type[Any], reliable: bool = False) -> "Subscription":
        """A subscription to a DDS topic, by its own name there."""
        way = Policy.Reliability.Reliable(0) if reliable else Policy.Reliability.BestEffort
        try:
            about = Topic(self._participant, topic, kind)
            reader = DataReader(self._participant, about, _quality(way, DEPTH))
        except DDSException as error:
            raise Refusal(f"DDS has no topic {topic!r}: {error}") from error
        return Subscription(self._kept(reader))

    def others(self, *topics: str) -> tuple[str, ...]:
        """Who else publishes on these topics: process and host where they tell, else their GUID."""
        wanted = {mangled(topic) for topic in topics}
        with suppress(DDSException):
            ours = self._participant.guid
            found = {
                seen.participant_key
                for seen in self._publications.read(MOST_ENDPOINTS, self._living)
                if seen.topic_name in wanted and seen.participant_key != ours
            }
            told = {seen.key: seen.qos for seen in self._participants.read(MOST_ENDPOINTS)}
            return tuple(sorted(_called(key, told.get(key)) for key in found))
        return ()

    def waiting(self, subscriptions: Sequence["Subscription"]) -> "Waiting":
        """What waits for a message on any of these."""
        return Waiting(self._kept(WaitSet(self._participant)), subscriptions)

    def close(self) -> None:
        """Leave the domain, with all that was made here. May be called twice."""
        for entity in reversed(self._entities):
            _delete(entity)
        self._entities.clear()
        _shut(self._number, self)

    def _kept(self, entity: Any) -> Any:
        self._entities.append(entity)
        return entity


class Publisher:
    """What we say on a topic."""

    def __init__(self, writer: DataWriter, kind: type[Any]):
        self._writer, self._kind = writer, kind

    def send(self, **fields: Any) -> None:
        """Publish a message; the fields that are not given are zero. Never raises, never waits."""
        with suppress(DDSException):
            self._writer.write(self._kind(**fields))

    def heard(self) -> bool:
        """Whether anybody listens."""
        with suppress(DDSException):
            return bool(self._writer.get_matched_subscriptions())
        return False

    def close(self) -> None:
        """Stop publishing."""
        _delete(self._writer)


class Subscription:
    """What comes on a topic."""

    def __init__(self, reader: DataReader):
        self._reader = reader
        self.unread = ReadCondition(reader, ViewState.Any | SampleState.NotRead | InstanceState.Any)

    def take(self) -> list[Any]:
        """What came since the last call, oldest first; what cannot be read is left out."""
        came = []
        for _ in range(DEPTH):
            try:
                samples = self._reader.take(1)
            except Exception:  # cyclonedds raises what struct and codecs raise
                continue
            if not samples:
                break
            came += [one for one in samples if isinstance(one, self._reader.topic.data_type)]
        return came

    def latest(self) -> Any:
        """The last that came since the last call, or None."""
        came = self.take()
        return came[-1] if came else None

    def close(self) -> None:
        """Stop listening."""
        _delete(self.unread)
        _delete(self._reader)


class Waiting:
    """What waits for a message on any of several subscriptions."""

    def __init__(self, entity: WaitSet, subscriptions: Sequence[Subscription]):
        self._entity = entity
        for one in subscriptions:
            entity.attach(one.unread)

    def wait(self, seconds: float) -> None:
        """Wait until there is a message that was not taken, or for so long."""
        with suppress(DDSException):
            self._entity.wait(int(seconds * 1e9))

    def close(self) -> None:
        """Stop waiting."""
        _delete(self._entity)


def header() -> Any:
    """A std_msgs/Header of now, by the wall clock, as ROS 2 stamps its messages."""
    seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
    stamp = messages.idl("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)
    return messages.idl("std_msgs/msg/Header")(stamp=stamp)


def _quality(reliability: Any, depth: int) -> Qos:
    return Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(depth))


def _called(key: Any, quality: Qos | None) -> str:
    """A participant as its own properties call it."""
    told = {
        policy.key: policy.value
        for policy in (quality or ())
        if isinstance(policy, Policy.Property)
    }
    if "__ProcessName" not in told:
        return f"DDS participant {key}"
    host = told.get("__Hostname", "?")
    return f"{told['__ProcessName']} (process {told.get('__Pid', '?')} on {host})"


def _delete(entity: Entity) -> None:
    """Delete a DDS entity now, whoever still refers to it."""
    entity.__del__()


def _configuration(site: DDS) -> str:
    kind = "address" if site.interface.replace(".", "").isdigit() else "name"
    peers = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in site.peers)
    return (
        '<CycloneDDS><Domain Id="any"><General><Interfaces>'
        f"<NetworkInterface {kind}={quoteattr(site.interface)}/></Interfaces>"
        "<AllowMulticast>false</AllowMulticast></General><Discovery>"
        f"<ParticipantIndex>auto</ParticipantIndex><Peers>{peers}</Peers></Discovery>"
        f"<Internal><MaxSampleSize>{LARGEST}B</MaxSampleSize></Internal></Domain></CycloneDDS>"
    )


def _open(site: DDS, user: Domain) -> None:
    """Open the domain for a user: its sockets and threads are one for the whole process."""
    wanted = _configuration(site)
    with _lock:
        if site.domain not in _wires:
            try:
                wire = Wire(site.domain, wanted)
            except (DDSException, UnicodeError) as error:
                raise Refusal(
                    f"DDS cannot open domain {site.domain} on interface {site.interface!r} with "
                    f"peers {list(site.peers)}; see `ip address` for the interface's name"
                ) from error
            _wires[site.domain] = (wanted, wire, set())
        configured, _, users = _wires[site.domain]
        if configured != wanted:
            raise Refusal(
                f"DDS domain {site.domain} is open with another interface or other peers than "
                f"{site.interface!r} and {list(site.peers)}; write another domain"
            )
        users.add(user)


def _shut(number: int, user: Domain) -> None:
    """Let go of the domain; the last one closes its sockets and threads."""
    with _lock:
        if number in _wires and user in _wires[number][2]:
            _, wire, users = _wires[number]
            users.remove(user)
            if not users:
                del _wires[number]
                _delete(wire)
