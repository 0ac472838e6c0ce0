# pyright: reportMissingImports=false
"""The operator's stop as a topic: a String that says hold, land, emergency, or just stop."""

from math import inf
from typing import Any

from skydog.flight.supervisor import Order
from skydog.lab.orders import WORDS, Orders

TOPIC = "/skydog/stop"
LOOKS = 0.05  # s between looks at DDS, which does not call


class StopTopic:
    """Hears the topic over whatever a site speaks: ROS 1, DDS, or both."""

    def __init__(self, node: Any, domain: Any, orders: Orders):
        self._orders, self._due = orders, -inf
        self._ros1: Any = None
        self._dds: Any = None
        if node is not None:
            from std_msgs.msg import String

            self._ros1 = node.subscribe(TOPIC, String, lambda message: self._give(message.data))
        if domain is not None:
            self._dds = domain.subscribe(TOPIC, "std_msgs/msg/String", reliable=True)

    def look(self, now: float) -> None:
        """Take what came over DDS."""
        if self._dds is None or now < self._due:
            return
        self._due = now + LOOKS
        for message in self._dds.take():
            self._give(message.data)

    def close(self) -> None:
        """Hear no more."""
        if self._ros1 is not None:
            self._ros1.unregister()
        if self._dds is not None:
            self._dds.close()

    def _give(self, word: str) -> None:
        self._orders.give(WORDS.get(word.strip().lower()[:20], Order.STOP), f"topic {TOPIC}")
