# pyright: reportMissingImports=false
import ast
import math
import shutil
import signal
import time
from pathlib import Path

import pytest
import ros
from hypothesis import given
from hypothesis import strategies as st

from skydog.lab import guard
from skydog.lab.emulation.master import Master
from skydog.lab.guard import AGAIN, STILL, Guard, Said

FILE = Path(guard.__file__)
TIMEOUT, AFTER = 0.5, 2.0

moments = st.floats(0.0, 5.0)
numbers = st.floats(allow_nan=True, allow_infinity=True)
twists = st.tuples(*[numbers] * 6)


def guarding(land_after=None):
    return Guard(TIMEOUT, 0.5, 2.0, land_after, 0.0)


@given(twists)
def test_what_passes_is_a_number_and_within_limits(twist):
    passed = guarding().hear(twist, 0.0).twist
    if not all(map(math.isfinite, twist)):
        assert passed is None
    else:
        assert passed == tuple(
            min(max(x, -most), most)
            for x, most in zip(twist, (0.5, 0.5, 0.5, 2.0, 2.0, 2.0), strict=True)
        )


@given(st.lists(st.tuples(moments, st.none() | twists), max_size=30))
def test_a_robot_is_stopped_when_and_only_when_nothing_came_for_the_timeout(events):
    guarded, now, heard = guarding(AFTER), 0.0, 0.0
    landed = -math.inf
    for later, twist in events:
        now += later
        if twist is None:
            silent = now - heard - TIMEOUT
            said = guarded.tick(now)
            assert said.twist == (STILL if silent >= 0.0 else None)
            assert said.land == (silent >= AFTER and now - landed >= AGAIN)
            landed = now if said.land else landed
        else:
            guarded.hear(twist, now)
            heard = now if all(map(math.isfinite, twist)) else heard


@given(st.lists(moments, max_size=30))
def test_a_rover_is_never_landed(steps):
    guarded, now = guarding(), 0.0
    for later in steps:
        now += later
        assert not guarded.tick(now).land


def test_a_guard_that_has_heard_nothing_yet_stops_what_another_has_left_running():
    assert guarding().tick(TIMEOUT) == Said(STILL)


def test_the_guard_is_one_file_for_the_python_of_a_robot():
    tree = ast.parse(FILE.read_text(), feature_version=(3, 8))
    nodes = list(ast.walk(tree))
    froms = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    own = {"geometry_msgs.msg", "std_msgs.msg", "rospy"}
    standard = {"__future__", "argparse", "math", "signal", "sys", "threading", "time", "typing"}
    assert {*froms, *names} == own | standard


@pytest.fixture(scope="module")
def master():
    it = Master()
    yield it.uri
    it.close()


def base(name):
    return f"""
import rospy
from geometry_msgs.msg import Twist, Vector3
rospy.init_node({name!r})
out = rospy.Publisher("/ugv1/in", Twist, queue_size=1)
while not rospy.is_shutdown():
    out.publish(Twist(linear=Vector3(x=0.3)))
    rospy.sleep(0.02)
"""


GUARD = ("--in", "/ugv1/in", "--out", "/ugv1/cmd_vel", "--timeout", "0.3")


@ros.alone
def test_a_rover_that_latches_is_stopped_when_its_base_station_is_killed(master, tmp_path):
    from skydog.lab.emulation.ros1 import RoverROS1
    from skydog.lab.ros1 import Node

    file = shutil.copy(FILE, tmp_path)
    node = Node(ros.at(master), "room")
    guarded = RoverROS1(node, "/ugv1/cmd_vel", latches=True)
    bare = RoverROS1(node, "/ugv1/in", latches=True)
    with ros.python(file, master, *GUARD) as guard, ros.python(base("skydog"), master) as station:
        ros.until(lambda: guarded.step(time.monotonic())[0] == 0.3)
        ros.until(lambda: bare.step(time.monotonic())[0] == 0.3)
        ros.until(lambda: node.guarded("/ugv1/in"))
        station.kill()
        ros.until(lambda: guarded.step(time.monotonic()) == (0.0, 0.0))
        assert bare.step(time.monotonic()) == (0.3, 0.0)
        guard.terminate()
        assert guard.wait(ros.PATIENCE) == 0
        ros.until(lambda: not node.guarded("/ugv1/in"))
    node.close()


@ros.alone
def test_a_guard_refuses_a_stranger_by_name_and_lands_the_drone(master, tmp_path):
    from std_msgs.msg import Empty

    from skydog.lab.emulation.ros1 import RoverROS1
    from skydog.lab.ros1 import Node

    land = ("--land", "/ardrone/land", "--land-after", "0.2")
    node, landed = Node(ros.at(master), "room"), []
    rover = RoverROS1(node, "/ugv1/cmd_vel", latches=True)
    node.subscribe("/ardrone/land", Empty, landed.append)
    with (
        ros.python(shutil.copy(FILE, tmp_path), master, *GUARD, *land) as guard,
        ros.python(base("stranger"), master),
    ):
        assert guard.stderr is not None
        assert any("not from /stranger, only from /skydog" in line for line in guard.stderr)
        ros.until(lambda: len(landed) > 1)
        assert rover.step(time.monotonic()) == (0.0, 0.0)
        guard.send_signal(signal.SIGINT)
        assert guard.wait(ros.PATIENCE) == 0
    node.close()
