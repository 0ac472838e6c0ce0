"""What a drone is told by MAVLink and over which links, message by message."""

import math
import os
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pymavlink", reason="pymavlink is not installed")

from vehicles import (
    HEIGHT,
    PATIENCE,
    Vehicle,
    commands,
    heard,
    heartbeat,
    packed,
    played,
    told,
    until,
)

from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab import mavlink as adapter
from skydog.lab.mavlink import Link, MavlinkDrone, Rate, mavlink, parsed

NORTH = math.pi / 2


def test_the_motors_are_forced_off_in_an_emergency_only():
    with played() as (drone, vehicle):
        for i, mode in enumerate(Mode):
            for step, (armed, state) in enumerate([(False, 0), (True, 6 << 16)]):
                vehicle.say(heartbeat(armed=armed, mode=state))
                until(lambda armed=armed: drone._armed == armed)
                messages = heard(drone, vehicle, mode, 1.0, 1e6 + 100 * i + 10 * step)
                forced = [m for m in commands(messages) if m.param2 == 21196]
                disarms = [m for m in commands(messages) if m.command == 400 and m.param1 == 0]
                assert disarms == forced
                assert bool(forced) == (mode is Mode.EMERGENCY)


def test_streams_keep_their_rates_and_masks():
    with played() as (drone, vehicle):
        messages = heard(drone, vehicle, Mode.READY, 2.0, 5.0, position=(1.0, 2.0, 3.0), yaw=NORTH)
        poses = [m for m in messages if m.get_type() == "VISION_POSITION_ESTIMATE"]
        targets = [m for m in messages if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
        assert len(poses) == pytest.approx(100, abs=2)
        assert len(targets) == pytest.approx(50, abs=2)
        assert (poses[0].x, poses[0].y, poses[0].z) == (2.0, 1.0, -3.0)
        assert poses[0].yaw == pytest.approx(0.0)
        assert math.isnan(poses[0].covariance[0])
        assert targets[0].type_mask == 1 + 2 + 4 + 64 + 128 + 256 + 2048
        assert targets[0].coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
        turned = heard(drone, vehicle, Mode.MISSION, 0.1, 9.0, yaw=0.0)
        held = [m.yaw for m in turned if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
        assert held[-1] == pytest.approx(0.0)  # the heading that it took off with


def test_ardupilot_gets_no_setpoints_while_it_takes_off_by_itself():
    with played(autopilot=3) as (drone, vehicle):
        vehicle.say(heartbeat(autopilot=3, armed=True, mode=4))
        until(lambda: drone._armed)
        messages = heard(drone, vehicle, Mode.TAKING_OFF, 1.0, 5.0, position=(0.0, 0.0, 0.1))
        assert {m.get_type() for m in messages} == {"VISION_POSITION_ESTIMATE", "COMMAND_LONG"}
        assert {m.command for m in commands(messages)} == {mavlink.MAV_CMD_NAV_TAKEOFF}
        assert commands(messages)[0].param7 == pytest.approx(HEIGHT - 0.1)
        vehicle.say(mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_NAV_TAKEOFF, 0))
        until(lambda: drone._climbing)
        assert not commands(heard(drone, vehicle, Mode.TAKING_OFF, 1.0, 7.0))


def test_a_pilot_who_takes_the_mode_during_take_off_keeps_it():
    with played() as (drone, vehicle):
        asked = commands(heard(drone, vehicle, Mode.TAKING_OFF, 1.0, 5.0))
        assert {m.command for m in asked} == {mavlink.MAV_CMD_DO_SET_MODE}
        vehicle.say(heartbeat(armed=True, mode=6 << 16))
        until(lambda: drone._armed)
        heard(drone, vehicle, Mode.TAKING_OFF, 1.0, 7.0)
        vehicle.say(heartbeat(armed=True, mode=3 << 16))
        until(lambda: drone._custom_mode == 3 << 16)
        assert not commands(heard(drone, vehicle, Mode.TAKING_OFF, 1.0, 9.0))
        landing = commands(heard(drone, vehicle, Mode.LANDING, 1.0, 11.0))
        assert {m.command for m in landing} == {mavlink.MAV_CMD_NAV_LAND}


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e300])
def test_numbers_that_no_packet_holds_are_not_sent(bad):
    with played() as (drone, vehicle):
        wrong = {"velocity": (bad, 0.0, 0.0), "position": (0.0, bad, 0.0)}
        assert not heard(drone, vehicle, Mode.MISSION, 0.2, 5.0, **wrong)
        assert heard(drone, vehicle, Mode.MISSION, 0.2, 6.0)


@pytest.mark.parametrize(("state", "emergency"), [(4, False), (5, False), (6, True), (8, True)])
def test_only_a_drone_that_is_lost_reports_an_emergency(state, emergency):
    with played() as (drone, vehicle):
        vehicle.say(heartbeat(state=state, mode=77))
        until(lambda: drone._custom_mode == 77)
        assert drone.status().emergency is emergency


def test_other_ground_stations_on_the_link_are_named():
    with played() as (drone, vehicle):
        assert drone.others() == ()
        for system in (255, *range(30, 90)):
            vehicle.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), (system, 190))
        vehicle.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), (255, 190))
        until(lambda: "ground station 255/190" in drone.others())
        assert len(drone.others()) <= 16


def test_a_second_drone_of_the_same_number_is_named_and_not_heard(monkeypatch):
    links = []
    monkeypatch.setattr(adapter, "Link", lambda uri: links.append(Link(uri)) or links[0])
    with ThreadPoolExecutor(1) as pool, closing(Vehicle().socket) as first:
        made = pool.submit(MavlinkDrone, "dog", "udpin:127.0.0.1:0")
        until(lambda: links)
        here = links[0]._socket.getsockname()
        first.sendto(packed(heartbeat()), here)
        with closing(made.result(PATIENCE)) as drone, closing(Vehicle().socket) as second:
            drone.send(told(Mode.EMERGENCY), 5.0)
            assert first.recvfrom(1000)[1] == here
            second.sendto(packed(heartbeat(armed=True, mode=6 << 16)), here)
            host, port = second.getsockname()
            until(lambda: drone.others() == (f"drone 1/1 at {host}:{port}",))
            assert drone.status().flying is False


@given(st.lists(st.binary(max_size=600), max_size=8), st.booleans())
def test_whatever_comes_a_parser_keeps_at_most_one_message(chunks, keep):
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    for chunk in chunks:
        parsed(parser, chunk, keep)
        assert len(parser.buf) <= (300 if keep else 0)
    for _ in range(300):  # a stream may wait for the rest of a message that never was one
        if any(m.get_type() == "HEARTBEAT" for m in parsed(parser, packed(heartbeat()), keep)):
            return
    pytest.fail("no message gets through any more")


def test_a_rate_is_kept_on_average_and_not_made_good_after_a_pause():
    rate = Rate(0.04)
    assert sum(rate.due(0.01 * i) for i in range(1000)) == pytest.approx(250, abs=1)
    assert sum(rate.due(1000 + 0.001 * i) for i in range(100)) <= 4


@pytest.mark.parametrize(
    "uri",
    ["", "udp", "/bin/sh", "csv:flight.csv", "udpin:127.0.0.1:", "udpin:127.0.0.1:70000",
     "udpin:127.0.0.1:99x", "tcp:127.0.0.1:1", "/dev/no-such-line", "/dev/null,9600", "/dev/tty,1"],
)  # fmt: skip
def test_what_is_no_link_is_refused_with_the_ways_to_write_one(uri):
    with pytest.raises(Refusal, match=r"udpin:127\.0\.0\.1:14540"):
        MavlinkDrone("dog", uri)


def test_a_link_without_a_copter_is_refused_by_its_name(monkeypatch):
    monkeypatch.setattr(adapter, "PATIENCE", 0.2)
    before = set(threading.enumerate())
    with pytest.raises(Refusal, match=r"dog: no HEARTBEAT .* at udpin:127\.0\.0\.1:0 "):
        MavlinkDrone("dog", "udpin:127.0.0.1:0")
    assert set(threading.enumerate()) <= before


def test_a_plane_is_refused_and_named(monkeypatch):
    monkeypatch.setattr(adapter, "PATIENCE", 1.0)
    vehicle = Vehicle()
    with closing(vehicle.socket), ThreadPoolExecutor(1) as pool:
        made = pool.submit(MavlinkDrone, "dog", vehicle.uri)
        vehicle.hear()
        vehicle.say(heartbeat(autopilot=3, kind=1))
        with pytest.raises(Refusal, match="MAV_AUTOPILOT_ARDUPILOTMEGA MAV_TYPE_FIXED_WING"):
            made.result(PATIENCE)


def test_a_serial_line_carries_it_too():
    ours, line = os.openpty()
    with ThreadPoolExecutor(1) as pool:
        made = pool.submit(MavlinkDrone, "dog", f"{os.ttyname(line)},57600")

        def heard_of():
            os.write(ours, b"boot" + packed(heartbeat()))
            return made.done()

        until(heard_of)
    with closing(made.result()) as drone:
        assert drone.status().connected
        until(lambda: parsed(mavlink.MAVLink(None), os.read(ours, 1000), False))
        os.close(line)
        os.close(ours)
        drone.send(told(Mode.EMERGENCY), 5.0)


def test_tcp_carries_it_too_and_may_break():
    with closing(socket.create_server(("127.0.0.1", 0))) as server, ThreadPoolExecutor(1) as pool:
        port = server.getsockname()[1]
        made = pool.submit(MavlinkDrone, "dog", f"tcp:127.0.0.1:{port}")
        with closing(server.accept()[0]) as vehicle:
            beat = packed(heartbeat())
            vehicle.sendall(beat[:5])
            vehicle.sendall(beat[5:])
            drone = made.result(PATIENCE)
        with closing(drone):
            until(lambda: drone._link._gone)
            drone.send(told(Mode.EMERGENCY), 5.0)
