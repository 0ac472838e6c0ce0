"""The operator's stop by a topic, over DDS; `test_ros1_node.py` has it over ROS 1."""

import os
import time

import pytest

from skydog.flight.supervisor import Order
from skydog.lab.domain import Domain
from skydog.lab.orders import Orders
from skydog.lab.site import DDS
from skydog.lab.stop_topic import TOPIC, StopTopic

# A domain for each worker of the tests.
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
SITE = DDS(domain=(os.getppid() * 7 + WORKER) % 90)


@pytest.mark.parametrize(
    ("word", "order"),
    [
        ("hold", Order.HOLD),
        (" Land\n", Order.LAND),
        ("emergency", Order.EMERGENCY),
        ("", Order.STOP),
        ("x" * 1000, Order.STOP),
    ],
)
def test_what_is_said_on_the_topic_is_an_order(word, order):
    station, robots = Domain(SITE), Domain(SITE)
    orders = Orders()
    stop = StopTopic(None, station, orders)
    try:
        says = robots.publish(TOPIC, "std_msgs/msg/String")
        given = (Order.NONE, "")
        deadline = time.monotonic() + 20.0
        while given[0] == Order.NONE and time.monotonic() < deadline:
            says.send(data=word)
            stop.look(time.monotonic())
            given = orders.take()
            time.sleep(0.01)
        assert given == (order, f"topic {TOPIC}")
    finally:
        stop.close()
        station.close()
        robots.close()
