# pyright: reportMissingImports=false
"""The ROS 1 node of this process, by Debian's rospy."""

import contextlib
import http.client
import os
import threading
import xmlrpc.client
from collections.abc import Callable
from typing import Any

from skydog.errors import Refusal
from skydog.lab.site import ROS1

try:
    import geometry_msgs.msg  # noqa: F401  `ros1` needs it: refused here too
    import rosgraph.names
    import rospy
    from rospy.impl.registration import get_topic_manager
except ImportError as missing:
    raise Refusal(
        "ROS 1 needs rospy; run make ros in a clone, or: apt install python3-rospy "
        "python3-geometry-msgs python3-std-msgs"
    ) from missing

PATIENCE = 2.0  # s that a master, or another node, is waited for
LOOK = 1.0  # s between looks at the master


class Node:
    """The ROS 1 node of this process: rospy allows one, for as long as the process lives.

    It looks at the master once a second, in a thread of its own: who else publishes our topics,
    who guards them, and whether a master that was restarted knows us. Nodes that are connected do
    not need it.
    """

    def __init__(self, site: ROS1, name: str = "skydog"):
        """Refused if no master answers, or if a node of this name runs already."""
        if rospy.core.is_initialized():
            raise Refusal("rospy allows one ROS 1 node in a process; use the one that there is")
        self.name = f"/{name}"
        self._publishers: dict[str, list[str]] = {}
        self._subscribers: dict[str, list[str]] = {}
        self._closed = threading.Event()
        try:
            self._master = _server(site.master)
            self._ask("getPid")
        except Exception as error:  # refused, unknown host, no URI, not a master
            raise Refusal(
                f"no ROS 1 master answers at {site.master!r}; start roscore there, or write its "
                "address as ros1.master in the site file"
            ) from error
        self._refuse_namesake()
        os.environ.update(ROS_MASTER_URI=site.master, ROS_IP=site.address)
        os.environ.pop("ROS_HOSTNAME", None)  # it would go before ROS_IP
        rospy.init_node(name, argv=[], disable_signals=True, disable_rosout=True)
        self._thread = threading.Thread(target=self._watch, name="ROS 1 master", daemon=True)
        self._thread.start()

    def publisher(self, topic: str, kind: type[Any]) -> rospy.Publisher:
        """A publisher that never blocks: of what waits to be sent, the latest is kept."""
        return rospy.Publisher(_absolute(topic), kind, queue_size=1, tcp_nodelay=True)

    def subscribe(
        self, topic: str, kind: type[Any], hear: Callable[[Any], None]
    ) -> rospy.Subscriber:
        """Hear the latest messages of a topic, in a thread of rospy."""
        return rospy.Subscriber(_absolute(topic), kind, hear, queue_size=1, tcp_nodelay=True)

    def others(self, *topics: str) -> tuple[str, ...]:
        """The nodes but ours that publish any of the topics, as of the last look."""
        found = {name for topic in topics for name in self._publishers.get(_absolute(topic), ())}
        return tuple(sorted(found - {self.name}))

    def guarded(self, topic: str) -> bool:
        """Whether a `skydog.lab.guard` hears the topic, as of the last look."""
        names = self._subscribers.get(_absolute(topic), ())
        return any(name.rpartition("/")[2].startswith("guard") for name in names)

    def close(self) -> None:
        """Leave the master and let go of every topic. May be called twice.

        Must be called: threads of rospy that are not daemons would keep the process from ending.
        """
        self._closed.set()
        self._thread.join()
        rospy.signal_shutdown("closed")

    def _ask(self, call: str, *arguments: str) -> Any:
        """What the master answers. Raises whatever xmlrpc does, and ValueError if it says no."""
        code, said, answer = getattr(self._master, call)(self.name, *arguments)
        if code != 1:
            raise ValueError(said)
        return answer

    def _refuse_namesake(self) -> None:
        """A master ends the elder of two nodes of one name: in flight, that would be ours."""
        try:
            _server(self._ask("lookupNode", self.name)).getPid(self.name)
        except Exception:  # there is none, or only the name of one that has died
            return
        raise Refusal(f"a node {self.name} runs at this ROS 1 master already; end that one first")

    def _watch(self) -> None:
        while True:
            # Whatever is wrong with a master that is away or just starting, the next look will
            # tell; until then the last one holds.
            with contextlib.suppress(Exception):
                self._look()
            if self._closed.wait(LOOK):
                return

    def _look(self) -> None:
        publishers, subscribers, _ = self._ask("getSystemState")
        self._publishers = dict(publishers)
        self._subscribers = dict(subscribers)
        topics: Any = get_topic_manager()
        uri: Any = rospy.get_node_uri()
        with topics.lock:  # or a topic closed meanwhile would be registered for ever
            for topic, kind in topics.get_publications():
                if self.name not in self._publishers.get(topic, ()):
                    self._ask("registerPublisher", topic, kind, uri)
            for topic, kind in topics.get_subscriptions():
                if self.name not in self._subscribers.get(topic, ()):
                    found = self._ask("registerSubscriber", topic, kind, uri)
                    _server(uri).publisherUpdate(self.name, topic, found)


def publish(publisher: rospy.Publisher, message: Any) -> None:
    """Publish, and never raise."""
    with contextlib.suppress(rospy.ROSException):  # closed: nobody is there to be told
        publisher.publish(message)


def _absolute(topic: str) -> str:
    if not rosgraph.names.is_legal_name(topic):
        raise Refusal(f"{topic!r} is no name of a ROS 1 topic; try one such as /ugv1/cmd_vel")
    return "/" + topic.lstrip("/")


class _Patient(xmlrpc.client.Transport):
    """Waits for an answer, but not for ever."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = PATIENCE
        return connection


def _server(uri: str) -> Any:
    return xmlrpc.client.ServerProxy(uri, transport=_Patient())
