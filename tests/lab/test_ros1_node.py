# pyright: reportMissingImports=false
import threading
import time
from typing import Any

import pytest
import ros

from skydog.errors import Refusal
from skydog.lab.emulation.master import Master
from skydog.lab.site import ROS1, Mocap, UAVSite, UGVSite

UAV = UAVSite("drone", "tum-simulator")
UGV = UGVSite("ugv1")


@pytest.fixture(scope="module")
def master():
    it = Master()
    yield it.uri
    it.close()


@ros.alone
def test_a_second_publisher_is_named(master):
    from skydog.lab.ros1 import Node, TumSimulator, TwistRover

    node = Node(ros.at(master))
    drone, rover = TumSimulator(node, UAV), TwistRover(node, UGV)
    assert drone.others() == rover.others() == ()
    stranger = "import rospy\nfrom geometry_msgs.msg import Twist\nrospy.init_node('joystick')\n"
    stranger += "out = rospy.Publisher('/cmd_vel', Twist, queue_size=1)\nrospy.spin()\n"
    with ros.python(stranger, master):
        ros.until(lambda: drone.others() == ("/joystick",))
        assert rover.others() == ()
        assert not node.guarded("/cmd_vel")
    node.close()


@ros.alone
def test_a_stop_that_a_stranger_publishes_is_an_order(master):
    from skydog.flight.supervisor import Order
    from skydog.lab.orders import Orders
    from skydog.lab.ros1 import Node
    from skydog.lab.stop_topic import TOPIC, StopTopic

    node, orders = Node(ros.at(master)), Orders()
    stop = StopTopic(node, None, orders)
    stranger = "import rospy\nfrom std_msgs.msg import String\nrospy.init_node('phone')\n"
    stranger += f"out = rospy.Publisher('{TOPIC}', String, queue_size=1, latch=True)\n"
    stranger += "out.publish('land')\nrospy.spin()\n"
    with ros.python(stranger, master):
        ros.until(lambda: orders.take() == (Order.LAND, f"topic {TOPIC}"))
    stop.close()
    node.close()


LISTENER = """
import rospy
from geometry_msgs.msg import Twist
rospy.init_node("listener", anonymous=True)
rospy.Subscriber("/ugv1/cmd_vel", Twist, lambda twist: print(twist.linear.x, flush=True))
rospy.spin()
"""


@ros.alone
def test_a_master_killed_and_restarted_is_told_of_us_and_messages_flow_on(master):
    from skydog.lab.ros1 import Node, TwistRover, ViconSource

    room = Master()
    node = Node(ros.at(room.uri))
    rover = TwistRover(node, UGV)
    source = ViconSource(node, Mocap(source="ros1"), ["drone"])
    sent = 0.0

    def heard(listener):
        """What is sent from now on arrives."""
        nonlocal sent
        sent += 1.0
        came = []

        def read():
            while not came or came[-1] < sent:
                came.append(float(listener.stdout.readline()))

        thread = threading.Thread(target=read)
        thread.start()

        def arrived():
            rover.send(sent, 0.0, 0.0)
            return not thread.is_alive()

        ros.until(arrived)
        return came[-1] == sent

    with ros.python(LISTENER, room.uri) as old:
        assert heard(old)
        port = room.port
        room.kill()
        assert heard(old)
        room = Master(port)
        with ros.python(LISTENER, room.uri) as new, ros.python(BRIDGE, room.uri):
            assert heard(new)
            assert heard(old)
            assert source.wait(time.monotonic() + ros.PATIENCE)
    node.close()
    room.close()


BRIDGE = """
import rospy
from skydog.lab.emulation.ros1 import ViconBridge
from skydog.lab.ros1_node import Node
from skydog.lab.site import ROS1, Mocap
import os
node = Node(ROS1(master=os.environ["ROS_MASTER_URI"]), "bridge")
bridge = ViconBridge(node, Mocap(source="ros1"), ("drone",))
while True:
    bridge.show("drone", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    rospy.sleep(0.02)
"""

RECORDER = """
import sys, threading, rosbag, rospy
from rostopic import get_topic_class
rospy.init_node("recorder")
bag, three = rosbag.Bag(sys.argv[1], "w"), threading.Semaphore(0)
kind, topic, _ = get_topic_class("/ugv1/cmd_vel", blocking=True)
def write(message):
    if not rospy.is_shutdown():
        bag.write(topic, message)
        three.release()
heard = rospy.Subscriber(topic, kind, write)
for _ in range(3):
    three.acquire()
heard.unregister()
rospy.signal_shutdown("three")
bag.close()
"""


@ros.alone
def test_the_tools_of_ros_show_and_record_what_a_rover_is_told(master, tmp_path):
    from rosbags.highlevel import AnyReader

    from skydog.lab.ros1 import Node, TwistRover

    pytest.importorskip("rostopic", reason="rostopic of ROS 1 is not here; see make ros")
    pytest.importorskip("rosbag", reason="rosbag of ROS 1 is not here; see make ros")
    node = Node(ros.at(master))
    rover = TwistRover(node, UGV)
    echo = "import rostopic\nrostopic.rostopicmain()\n"
    bag = tmp_path / "a.bag"
    with (
        ros.python(echo, master, "echo", "-n", "1", "/ugv1/cmd_vel") as shown,
        ros.python(RECORDER, master, str(bag)) as recorded,
    ):

        def ended():
            rover.send(0.25, -0.5, 0.0)
            return shown.poll() == recorded.poll() == 0

        ros.until(ended)
        assert shown.stdout is not None
        said = shown.stdout.read().split()
    numbers = [word for word in said if word.strip("-.0123456789") == "" and word != "---"]
    assert [float(number) for number in numbers] == [0.25, 0.0, 0.0, 0.0, 0.0, -0.5]
    with AnyReader([bag]) as reader:
        messages: list[Any] = [
            reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()
        ]
    assert [(twist.linear.x, twist.angular.z) for twist in messages] == [(0.25, -0.5)] * 3
    node.close()


@ros.alone
def test_a_master_that_is_not_there_a_second_node_and_a_namesake_are_refused(master):
    from skydog.lab.ros1 import Node, TwistRover

    for uri in ("http://127.0.0.1:1", "nowhere", "http://no such host:1"):
        with pytest.raises(Refusal, match=r"no ROS 1 master answers at .*ros1\.master"):
            Node(ROS1(master=uri))
    namesake = "import rospy\nrospy.init_node('skydog', disable_signals=True)\nprint(flush=True)\n"
    with ros.python(namesake + "rospy.spin()\n", master) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with pytest.raises(Refusal, match="a node /skydog runs at this ROS 1 master already"):
            Node(ros.at(master))
    node = Node(ros.at(master))  # its name is still at the master, but it is dead
    with pytest.raises(Refusal, match="one ROS 1 node in a process"):
        Node(ros.at(master), "another")
    with pytest.raises(Refusal, match="no name of a ROS 1 topic"):
        TwistRover(node, UGVSite("ugv1", topic="/ugv 1"))
    node.close()
    node.close()


def test_a_port_that_is_taken_is_refused(master):
    port = int(master.rstrip("/").rpartition(":")[2])
    with pytest.raises(Refusal, match="is it taken"):
        Master(port)
