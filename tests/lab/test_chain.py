# pyright: reportMissingImports=false
"""The whole emulated laboratory over real sockets, seen from without: a short flight each way."""

import contextlib
import json
import math
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import pytest
from realtime import in_real_time

pytest.importorskip("rosbags", reason="skydog[lab] is not installed")

from skydog.errors import Refusal
from skydog.lab import flightlog
from skydog.lab.emulation.chain import Chain, a_site
from skydog.lab.emulation.flights import Emulated
from skydog.lab.emulation.room import Start
from skydog.lab.orders import Orders
from skydog.lab.running import Automatic, as_json, fly
from skydog.lab.site import Mission
from skydog.shepherds.strombom import Strombom
from skydog.world.presets import preset
from skydog.world.state import start

PATIENCE = 120.0  # s for whatever must come
SHEEP = ((3.3, 4.5), (3.6, 4.0), (4.5, 2.1))
START = Start(dogs=((1.0, 5.0),), sheep=SHEEP, size=6.0, goal=(0.0, 0.0, 2.0), disturb="mild")
LARGEST = 3.5  # m/s and rad/s: more is never told to anybody; a Kobuki turns at 3.14

# A stranger's node: all that it hears until its standard input ends, as JSON.
LISTENER = """
import json, sys, rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Empty
heard = {topic: [] for topic in sys.argv[1:]}
def hear(topic):
    def twist(t):
        heard[topic].append([t.linear.x, t.linear.y, t.linear.z] +
                            [t.angular.x, t.angular.y, t.angular.z])
    kind, took = (Twist, twist) if "cmd_vel" in topic else (Empty, heard[topic].append)
    rospy.Subscriber(topic, kind, took if kind is Twist else lambda _: took(0))
rospy.init_node("stranger", disable_signals=True, disable_rosout=True)
for topic in heard:
    hear(topic)
print("here", flush=True)
sys.stdin.read()
print(json.dumps(heard))
"""


def base_station(log, wire):
    """The base station's process: it says what happens, and lands when it is told to."""
    site, landed = wire.recv(), threading.Event()
    orders = Orders()
    threading.Thread(target=lambda: (wire.recv(), landed.set()), daemon=True).start()
    operator = Automatic(orders, PATIENCE, finished=lambda station: landed.is_set())
    outcome = fly(site, orders, operator, log, as_json(site), said=wire.send, here=log.parent)
    wire.send((outcome.how, outcome.steps, outcome.times.blind))


class Flight:
    """A base station's process, and what it has said. It flies the site that it is sent."""

    def __init__(self, log):
        context = multiprocessing.get_context("spawn")
        self._wire, theirs = context.Pipe()
        arguments = (log, theirs)
        self.process = context.Process(target=base_station, args=arguments, daemon=True)
        self.process.start()
        theirs.close()
        self.lines: list[str] = []

    def until(self, text):
        """Wait until it says so, from now on."""
        end = time.monotonic() + PATIENCE
        with contextlib.suppress(EOFError):
            while self._wire.poll(max(0.0, end - time.monotonic())):
                said = self._wire.recv()
                self.lines.append(str(said))
                if text in self.lines[-1]:
                    return said
        raise AssertionError(f"{text!r} did not come; it said {self.lines}")

    def send(self, what):
        self._wire.send(what)

    def ended(self):
        """How it ended, how many steps it flew, and how long it was blind."""
        return self.until("('")

    def close(self):
        self.process.join(10.0)
        self.process.kill()
        self.process.join()


@contextmanager
def laboratory(transport, tmp_path):
    """An emulated laboratory, and a base station that flies it."""
    site = a_site(Mission(sheepdog="strombom", steps=200), 6.0, transport)
    flight = Flight(tmp_path / "flight")  # its imports take as long as the room's
    try:
        with Chain(site, START) as chain:
            flight.send(chain.site)
            yield chain, flight
    finally:
        flight.close()


def fly_through_a_silence(chain, flight):
    """Take off, lose sight in the mission, find it again, go on, land: how it ended."""
    flight.until("disarmed → ready")
    flight.until("ready → taking off")
    flight.until("taking off → mission")
    time.sleep(1.0)  # some decisions
    chain.change("faults", "silent", True)
    said = flight.until("mission → hold: eyes stale")
    chain.change("faults", "silent", False)
    assert "not seen for 0.1" in said
    assert "stale" in said
    flight.until("well again")  # "low" if it was still settling
    time.sleep(1.0)
    flight.send("land")
    flight.until("→ landing: operator: land")
    flight.until("landing → disarmed: landed")
    return flight.ended()


def judge(chain, flight, ended, log):
    """Nothing left the cage, nobody crashed, and the log is a trace of the mission."""
    how, steps, blind = ended
    report = chain.report()
    assert how == "stopped by the supervisor"
    assert steps >= 3
    assert blind < 0.5
    assert report.beyond < 0.0
    assert report.rover_beyond < 0.0
    assert not report.crashed
    assert report.off == (True,)
    trace, shepherd = flightlog.load(log)
    assert shepherd == "strombom"
    assert len(trace.time) == steps
    assert trace.poses is not None
    assert float(trace.poses.altitude.max()) < 2.3
    moved = math.dist(report.dogs[0][:2], START.dogs[0])
    assert moved > 0.3


def finite(numbers):
    return all(math.isfinite(number) and abs(number) <= LARGEST for number in numbers)


def test_a_flight_over_dds_holds_while_nothing_is_seen_and_a_stranger_understands_it(tmp_path):
    pytest.importorskip("cyclonedds", reason="skydog[lab] is not installed")

    def flown(folder):
        with laboratory("dds", folder) as (chain, flight), strangers(chain.site.dds) as heard:
            ended = fly_through_a_silence(chain, flight)
            said = heard()
        judge(chain, flight, ended, folder / "flight")
        return said

    told, words = in_real_time(flown, tmp_path)
    assert set(told) == {"uav1", "ugv1", "ugv2", "ugv3"}
    for twists in told.values():
        assert all(map(finite, twists))
    assert max(math.hypot(*twist[:2]) for twist in told["uav1"]) > 0.1
    for name in ("ugv1", "ugv2", "ugv3"):  # a rover drives forwards, and turns about its height
        assert all(twist[1:5] == (0.0, 0.0, 0.0, 0.0) for twist in told[name])
    assert words["takeoff"] >= 1
    assert words["land"] >= 1
    assert words["emergency"] == 0


@contextmanager
def strangers(dds):
    """Bare readers with types of their own; what they heard, by robot, and how often each word."""
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct, types
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    from skydog.lab.domain import Domain

    @dataclass
    class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
        x: float
        y: float
        z: float

    @dataclass
    class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
        linear: Vector3
        angular: Vector3

    @dataclass
    class Empty(IdlStruct, typename="std_msgs::msg::dds_::Empty_"):
        structure_needs_at_least_one_member: types.uint8

    domain = Domain(dds)  # loopback and its peers are set before anybody opens it
    try:
        bare = DomainParticipant(dds.domain)
        kept = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepAll)
        readers = {
            name: DataReader(bare, Topic(bare, f"rt/{name}/cmd_vel", Twist), kept)
            for name in ("uav1", "ugv1", "ugv2", "ugv3")
        }
        words = {
            word: DataReader(bare, Topic(bare, f"rt/uav1/{word}", Empty), kept)
            for word in ("takeoff", "land", "emergency")
        }

        def heard():
            told = {name: reader.take(100_000) for name, reader in readers.items()}
            flat = {
                name: [
                    (t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z)
                    for t in twists
                ]
                for name, twists in told.items()
            }
            return flat, {word: len(reader.take(100_000)) for word, reader in words.items()}

        yield heard
    finally:
        domain.close()


def test_a_flight_over_ros_1_holds_while_nothing_is_seen_and_a_stranger_understands_it(tmp_path):
    pytest.importorskip("rospy", reason="rospy of ROS 1 is not here; see make ros")
    pytest.importorskip("rosmaster", reason="rosmaster of ROS 1 is not here; see make ros")
    rovers = [f"/ugv{number}/cmd_vel" for number in (1, 2, 3)]
    words = ["/ardrone/takeoff", "/ardrone/land", "/ardrone/reset"]

    def flown(folder):
        with (
            laboratory("ros1", folder) as (chain, flight),
            listener(chain.site.ros1.master, [*rovers, "/cmd_vel", *words]) as heard,
        ):
            ended = fly_through_a_silence(chain, flight)
            said = heard()
        judge(chain, flight, ended, folder / "flight")
        return said

    told = in_real_time(flown, tmp_path)
    for topic in (*rovers, "/cmd_vel"):
        assert told[topic]
        assert all(map(finite, told[topic]))
    for topic in rovers:  # a rover drives forwards, and turns about its height
        assert all(twist[1:5] == [0.0, 0.0, 0.0, 0.0] for twist in told[topic])
    # What the guard passes on to an AR.Drone are shares of its greatest tilt, from -1 to 1.
    assert all(max(map(abs, twist[:3])) <= 1.0 for twist in told["/cmd_vel"])
    assert max(math.hypot(*twist[:2]) for twist in told["/cmd_vel"]) > 0.05
    assert told["/ardrone/takeoff"]
    assert told["/ardrone/land"]
    assert not told["/ardrone/reset"]


@contextmanager
def listener(master, topics):
    """A stranger's node, and a way to end it and learn what it heard."""
    env = {**os.environ, "ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1"}
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", LISTENER, *topics],
        env=env,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "here\n"
        yield lambda: json.loads(process.communicate(timeout=PATIENCE)[0])
    finally:
        process.kill()
        process.communicate()


def test_a_mission_that_a_laboratory_cannot_fly_is_refused_before_anything_starts():
    begin = start(jnp.ones((3, 2)), jnp.ones((2, 2)))
    starts = jax.tree.map(lambda leaf: leaf[None], begin)
    with pytest.raises(Refusal, match="flies one dog, got 2"):
        Emulated()(preset("paper-physical"), Strombom(), starts)
    noisy = preset("paper-physical")
    noisy = replace(noisy, dog=replace(noisy.dog, perception_noise=0.1))
    with pytest.raises(Refusal, match="a noise of its own"):
        Emulated()(noisy, Strombom(), replace(starts, dogs=starts.dogs[:, :1]))
