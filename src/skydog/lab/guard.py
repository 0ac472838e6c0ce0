#!/usr/bin/env python3
# pyright: reportMissingImports=false
"""The guard that runs on a robot: when its base station falls silent, the robot stops.

Some robots obey the last Twist until the next one comes, for ever. The guard stands between: it
passes Twists on within limits, and after a quarter of a second without any it says 20 times a
second that the robot is to stand still. A drone is landed after another fifth. It needs rospy and
Python 3.8, nothing else:

    scp guard.py robot: && ssh robot python3 guard.py --in /ugv1/cmd_vel_in --out /ugv1/cmd_vel

On the graph it is called `/guard_` and its topic, so that the base station can see it.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from typing import NamedTuple

PERIOD = 0.05  # s between words of a guard whose base station is silent
AGAIN = 0.5  # s between two orders to land
STILL = (0.0,) * 6


class Said(NamedTuple):
    """What a guard says: a Twist, or nothing; and whether to land."""

    twist: tuple[float, ...] | None
    land: bool = False


class Guard:
    """Twists and time in, Twists and orders to land out. Times are in seconds, of one clock.

    A Twist is six numbers, linear x, y, z and angular x, y, z; each is bounded by `speed` in m/s
    or `turn_rate` in rad/s. Silence counts from the start: nobody knows what the robot was told
    before.
    """

    def __init__(
        self, timeout: float, speed: float, turn_rate: float, land_after: float | None, now: float
    ):
        self._timeout = timeout
        self._limits = (speed,) * 3 + (turn_rate,) * 3
        self._land_after = math.inf if land_after is None else land_after
        self._heard = now
        self._told_to_land = -math.inf

    def hear(self, twist: tuple[float, ...], now: float) -> Said:
        """A Twist came. One that is no number is not passed on, and does not break the silence."""
        if not all(map(math.isfinite, twist)):
            return Said(None)
        self._heard = now
        return Said(tuple(map(_within, twist, self._limits)))

    def tick(self, now: float) -> Said:
        """Time goes by."""
        silent = now - self._heard - self._timeout
        if silent < 0.0:
            return Said(None)
        land = silent >= self._land_after and now - self._told_to_land >= AGAIN
        if land:
            self._told_to_land = now
        return Said(STILL, land)


def _within(value, most):
    return max(-most, min(value, most))


def main() -> None:
    """Guard until the process is told to end; then say once more that the robot stands still."""
    options = _options()
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())

    import rospy
    from geometry_msgs.msg import Twist, TwistStamped, Vector3
    from std_msgs.msg import Empty

    rospy.init_node("guard_" + options.source.strip("/").replace("/", "_"), disable_signals=True)
    kind = TwistStamped if options.stamped else Twist
    out = rospy.Publisher(options.out, kind, queue_size=1, tcp_nodelay=True)
    landing = rospy.Publisher(options.land, Empty, queue_size=1) if options.land else None
    limits = (options.max_speed, options.max_turn_rate)
    after = options.land_after if options.land else None
    guard = Guard(options.timeout, *limits, after, time.monotonic())
    lock = threading.Lock()  # rospy hears in threads of its own
    refused = set()

    def say(said):
        if said.twist is not None:
            twist = Twist(Vector3(*said.twist[:3]), Vector3(*said.twist[3:]))
            if options.stamped:
                twist = TwistStamped(twist=twist)
                twist.header.stamp = rospy.Time.now()
            out.publish(twist)
        if said.land and landing is not None:
            landing.publish(Empty())

    def hear(message):
        caller = message._connection_header["callerid"]
        twist = message.twist if options.stamped else message
        linear, angular = twist.linear, twist.angular
        six = (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
        with lock:
            if caller == options.base:
                say(guard.hear(six, time.monotonic()))
            elif caller not in refused:
                refused.add(caller)
                print(f"guard: not from {caller}, only from {options.base}", file=sys.stderr)

    rospy.Subscriber(options.source, kind, hear, queue_size=1, tcp_nodelay=True)
    while not ended.wait(PERIOD) and not rospy.is_shutdown():
        with lock:
            say(guard.tick(time.monotonic()))
    with lock:
        say(Said(STILL))
        time.sleep(PERIOD)  # rospy sends in a thread of its own
    rospy.signal_shutdown("ended")


def _options():
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--in", dest="source", required=True, help="topic that the base publishes")
    parser.add_argument("--out", required=True, help="topic that the robot obeys")
    parser.add_argument("--from", dest="base", default="/skydog", help="the node that may command")
    parser.add_argument("--timeout", type=_positive, default=0.25, help="s of silence")
    parser.add_argument("--max-speed", type=_positive, default=1.0, help="of each axis: m/s")
    parser.add_argument("--max-turn-rate", type=_positive, default=3.2, help="rad/s")
    parser.add_argument("--stamped", action="store_true", help="TwistStamped instead of Twist")
    parser.add_argument("--land", default="", help="topic of the order to land: /ardrone/land")
    parser.add_argument("--land-after", type=_positive, default=0.2, help="s of standing still")
    return parser.parse_args()


def _positive(text):
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"must be positive, got {text}")
    return value


if __name__ == "__main__":
    main()
