"""Vicon's packets, against bytes written by hand and against rubbish."""

import random
import socket
import struct
import time
import tracemalloc
from contextlib import closing
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skydog.errors import Refusal
from skydog.lab.vicon import Order, Receiver, decode, encode

LEVEL = (0.0, 0.0, 0.0, 1.0)
PATIENCE = 30.0  # s
angle = st.floats(-pi, pi)
name = st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=24)
place = st.tuples(*[st.floats(-900.0, 900.0)] * 3)
attitude = st.tuples(angle, st.floats(-pi / 2, pi / 2), angle).map(
    lambda angles: tuple(map(float, Rotation.from_euler("XYZ", angles).as_quat()))
)


def by_hand(number, *items, count=None, size=256):
    """A packet as the public descriptions have it: number, items, then 75 bytes for each."""
    packet = struct.pack("<I", number) + struct.pack("<B", len(items) if count is None else count)
    for label, *pose in items:
        packet += b"\x00" + b"\x48\x00" + label.ljust(24, b"\x00") + struct.pack("<6d", *pose)
    return packet + bytes(size - len(packet))


DOG = (b"dog", 1000.0, -2000.0, 1500.0, 0.0, 0.0, pi / 2)
SHEEP = (b"sheep1", 250.0, 500.0, 80.0, 0.1, -0.2, 0.3)


def read(packet):
    """What `decode` makes of a packet that is one."""
    decoded = decode(packet)
    assert decoded is not None
    return decoded


def names(packet):
    return list(read(packet)[1])


def until_shown(receiver, holds):
    """The receiver's bodies once `holds` is true of them."""
    end = time.monotonic() + PATIENCE
    while not holds(bodies := receiver.bodies()):
        assert time.monotonic() < end
        receiver.wait(time.monotonic() + 0.1)
    return bodies


@pytest.fixture
def wire():
    """A receiver of dog and sheep1, and a function that sends it packets."""
    with (
        closing(Receiver("127.0.0.1", 0, ["dog", "sheep1"])) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        yield receiver, lambda packet: sender.sendto(packet, ("127.0.0.1", receiver.port))


def test_a_packet_written_by_hand_decodes_to_metres_and_quaternions():
    number, bodies = read(by_hand(7, DOG, SHEEP))
    assert number == 7
    assert bodies["dog"][0] == (1.0, -2.0, 1.5)
    np.testing.assert_allclose(bodies["dog"][1], [0, 0, 0.5**0.5, 0.5**0.5], atol=1e-12)
    assert bodies["sheep1"][0] == (0.25, 0.5, 0.08)
    # Capital letters: SciPy's intrinsic axes.
    turn = Rotation.from_euler("XYZ", [0.1, -0.2, 0.3]).as_quat()
    np.testing.assert_allclose(bodies["sheep1"][1], turn, atol=1e-12)


def test_a_packet_encodes_to_the_bytes_written_by_hand():
    half = 0.5**0.5
    sent = encode(7, {"dog": ((1.0, -2.0, 1.5), (0.0, 0.0, half, half))})
    assert sent[:56] == by_hand(7, DOG)[:56]
    assert sent[80:] == by_hand(7, DOG)[80:]
    np.testing.assert_allclose(struct.unpack("<3d", sent[56:80]), DOG[4:], atol=1e-12)
    zeros = ((0.0, 0.0, 0.0), LEVEL)
    assert encode(0, {"dog": zeros}) == by_hand(0, (b"dog", *[0.0] * 6))


@given(st.integers(0, 2**32 - 1), st.dictionaries(name, st.tuples(place, attitude), max_size=13))
def test_what_is_encoded_decodes_to_the_same_poses(number, bodies):
    again, found = read(encode(number, bodies))
    assert again == number
    assert list(found) == list(bodies)
    for label, (position, turn) in bodies.items():
        np.testing.assert_allclose(found[label][0], position, atol=1e-9)
        assert abs(np.dot(found[label][1], turn)) > 1 - 1e-9


@pytest.mark.parametrize("pitch", [pi / 2, -pi / 2])
def test_an_attitude_with_its_nose_straight_up_survives_the_wire(pitch):
    x, y, z, w = Rotation.from_euler("XYZ", [0.4, pitch, -1.1]).as_quat().tolist()
    _, found = read(encode(0, {"dog": ((1.0, 0.0, 0.0), (x, y, z, w))}))
    assert abs(np.dot(found["dog"][1], (x, y, z, w))) > 1 - 1e-9


@pytest.mark.parametrize(("objects", "size"), [(3, 256), (4, 512), (6, 512), (7, 1024), (13, 1024)])
def test_more_than_three_objects_need_a_larger_block_and_all_are_read(objects, size):
    bodies = {f"body{i}": ((float(i), 0.0, 1.0), LEVEL) for i in range(objects)}
    packet = encode(1, bodies)
    assert len(packet) == size
    assert [pose[0][0] for pose in read(packet)[1].values()] == list(range(objects))


@pytest.mark.parametrize("label", ["", "a" * 25, "dög", "dog\n"])
def test_a_name_that_the_stream_cannot_carry_is_refused(label):
    with pytest.raises(Refusal, match="24 printable ASCII"):
        encode(0, {label: ((0.0, 0.0, 0.0), LEVEL)})
    with pytest.raises(Refusal, match="24 printable ASCII"):
        Receiver("127.0.0.1", 0, [label])


def test_more_objects_than_a_block_holds_are_refused():
    with pytest.raises(Refusal, match="holds 13 objects, not 14"):
        encode(0, {f"body{i}": ((0.0, 0.0, 0.0), LEVEL) for i in range(14)})


def test_a_name_of_all_24_bytes_has_no_zero_at_its_end():
    assert names(by_hand(1, (b"x" * 24, *DOG[1:]))) == ["x" * 24]


@pytest.mark.parametrize("packet", [b"", b"\x01", bytes(4), by_hand(1, DOG)[:79]])
def test_bytes_that_are_no_packet_decode_to_nothing(packet):
    assert decode(packet) is None


def test_a_packet_without_items_is_a_frame_in_which_nobody_is_seen():
    assert decode(bytes(5)) == (0, {})


def test_of_a_packet_that_was_cut_the_whole_items_are_read():
    packet = by_hand(1, DOG, SHEEP)
    assert names(packet[: 5 + 75 + 74]) == ["dog"]
    assert names(packet[: 5 + 75 + 75]) == ["dog", "sheep1"]


def test_a_count_beyond_the_packet_reads_nothing_that_is_not_there():
    assert names(by_hand(1, DOG, count=255, size=80)) == ["dog"]


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf"), 1.1e6, 1e308])
@pytest.mark.parametrize("which", range(6))
def test_an_object_with_an_impossible_number_is_left_out_and_the_next_is_read(bad, which):
    pose = list(DOG[1:])
    pose[which] = bad
    assert names(by_hand(1, (b"dog", *pose), SHEEP)) == ["sheep1"]


@pytest.mark.parametrize("label", [b"", b"\x00dog", b"d\xf6g", b"dog\n", b"\x1b[2Jdog", b"\x7f"])
def test_an_object_without_a_printable_name_is_left_out_and_the_next_is_read(label):
    assert names(by_hand(1, (label, *DOG[1:]), SHEEP)) == ["sheep1"]


def test_of_two_objects_with_one_name_the_first_is_kept():
    assert read(by_hand(1, DOG, (b"dog", *SHEEP[1:])))[1]["dog"][0] == (1.0, -2.0, 1.5)


def test_items_of_other_kinds_and_sizes_are_stepped_over():
    first, second = by_hand(1, DOG)[5:80], by_hand(1, SHEEP)[5:80]
    other = b"\x01" + first[1:]
    longer = b"\x00\x4c\x00" + first[3:] + b"more"
    header = struct.pack("<IB", 1, 2)
    assert names(header + other + second) == ["sheep1"]
    assert names(header + longer + second) == ["dog", "sheep1"]
    shorter = b"\x00\x47\x00" + first[3:]
    assert decode(header + shorter + second) is None


def test_a_hundred_thousand_damaged_packets_are_decoded_without_an_error():
    rng = random.Random(1)
    whole = by_hand(3, DOG, SHEEP, (b"sheep2", *SHEEP[1:]))
    told = 0
    for turn in range(100_000):
        if turn % 2:
            packet = rng.randbytes(rng.randrange(300))
        else:
            packet = bytearray(whole)
            for _ in range(rng.randrange(1, 6)):
                packet[rng.randrange(230)] = rng.randrange(256)
            packet = bytes(packet[: rng.randrange(257)])
        decoded = decode(packet)
        for position, turned in decoded[1].values() if decoded else ():
            told += 1
            assert max(map(abs, position)) <= 1000.0
            assert abs(sum(part * part for part in turned) - 1.0) < 1e-9
    assert told > 10_000


def test_frame_numbers_may_wrap_and_skip_but_not_repeat_or_go_back():
    order = Order()
    numbers = [2**32 - 3, 2**32 - 1, 2**32 - 1, 0, 2**32 - 2, 1, 0, 500, 499]
    accepted = [True, True, False, True, False, True, False, True, False]
    assert [order.accepts(number) for number in numbers] == accepted


@pytest.mark.parametrize("latest", [5, 100_000, 2**31 + 5, 2**32 - 1])
def test_a_tracker_that_counts_anew_is_believed_after_ten_frames_in_a_row(latest):
    order = Order()
    order.accepts(latest + 100)
    begins = [order.accepts(number) for number in range(latest - 50, latest - 38)]
    assert begins == [False] * 9 + [True] * 3


def test_ten_late_packets_that_do_not_follow_one_another_restart_nothing():
    order = Order()
    order.accepts(1000)
    assert not any(order.accepts(number) for number in range(999, 900, -1))
    assert not any(order.accepts(900) for _ in range(50))
    for number in range(1001, 1101):
        assert order.accepts(number)
        assert not order.accepts(number - 5)


def test_a_tracker_that_counts_anew_is_believed_though_each_packet_comes_twice():
    order = Order()
    order.accepts(1000)
    accepted = [order.accepts(number) for number in range(20) for _ in range(2)]
    assert any(accepted)


def test_one_number_far_ahead_shuts_the_true_ones_out_for_ten_frames_at_most():
    order = Order()
    order.accepts(1)
    order.accepts(2**30)
    assert [order.accepts(number) for number in range(2, 13)] == [False] * 9 + [True] * 2


def test_a_receiver_shows_the_bodies_it_was_asked_for_and_when_they_came(wire):
    receiver, send = wire
    assert not receiver.wait(time.monotonic())
    before = time.monotonic()
    send(by_hand(7, DOG, (b"stranger", *DOG[1:])))
    assert receiver.wait(time.monotonic() + PATIENCE)
    bodies = receiver.bodies()
    assert list(bodies) == ["dog"]
    assert bodies["dog"].position == (1.0, -2.0, 1.5)
    assert bodies["dog"].number == 7
    assert before <= bodies["dog"].came <= time.monotonic()
    assert not receiver.wait(time.monotonic())


def test_a_body_that_is_left_out_keeps_the_number_of_its_last_frame(wire):
    receiver, send = wire
    send(by_hand(1, DOG, SHEEP))
    send(by_hand(2, DOG))
    bodies = until_shown(receiver, lambda bodies: "dog" in bodies and bodies["dog"].number == 2)
    assert bodies["sheep1"].number == 1


def test_a_late_packet_replaces_nothing_and_is_counted(wire):
    receiver, send = wire
    for number, x in ((10, 1.0), (9, 2.0), (10, 3.0), (11, 4.0)):
        send(by_hand(number, (b"dog", x, *DOG[2:]), *([SHEEP] if number != 11 else [])))
    bodies = until_shown(receiver, lambda bodies: "dog" in bodies and bodies["dog"].number == 11)
    assert bodies["sheep1"].number == 10
    assert (receiver.packets, receiver.bad, receiver.late) == (4, 0, 2)


def test_a_strangers_packet_does_not_move_the_count_of_frames(wire):
    receiver, send = wire
    send(by_hand(2**30, (b"stranger", *DOG[1:])))
    send(by_hand(5, DOG))
    assert until_shown(receiver, lambda bodies: bodies)["dog"].number == 5


def test_after_a_burst_of_a_thousand_frames_the_newest_is_shown_first(wire):
    receiver, send = wire
    end = time.monotonic() + PATIENCE
    for number in range(1000):
        send(by_hand(number, DOG, SHEEP))
        while number % 50 == 49 and receiver.packets <= number:  # or the system drops some
            assert time.monotonic() < end
            time.sleep(0.001)
    send(b"after all of them")
    while receiver.bad == 0:
        assert time.monotonic() < end
        time.sleep(0.001)
    assert receiver.bodies()["dog"].number == 999
    assert not receiver.wait(time.monotonic())


def test_thousands_of_rubbish_packets_leave_a_receiver_alive_and_no_larger(wire):
    receiver, send = wire
    rng = random.Random(2)

    def flood(packets, first):
        for number in range(packets):
            send(rng.randbytes(rng.randrange(1, 3000)))
            strange = str(rng.random()).encode()[:24]
            send(by_hand(rng.randrange(2**32), (strange, *DOG[1:])))
            if number % 16 == 0:  # the sender must not outrun the thread
                send(by_hand(first + number, DOG))
                receiver.wait(time.monotonic() + 1.0)
                receiver.bodies()

    flood(200, first=0)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        flood(1500, first=1000)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    send(by_hand(10_000, DOG, SHEEP))
    assert list(until_shown(receiver, lambda bodies: len(bodies) == 2)) == ["dog", "sheep1"]
    assert receiver.bad > 500
    assert grown < 100_000


def test_a_port_that_is_taken_is_refused_by_its_number(wire):
    receiver, _ = wire
    with pytest.raises(Refusal, match=rf"at 127\.0\.0\.1:{receiver.port}: .*in use; stop what"):
        Receiver("127.0.0.1", receiver.port, ["dog"])


@pytest.mark.parametrize(
    ("host", "port"), [("203.0.113.1", 0), ("127.0.0.1", 70_000), ("a" * 70, 0)]
)
def test_an_address_at_which_nobody_can_listen_is_refused(host, port):
    with pytest.raises(Refusal, match=r"write another mocap\.host"):
        Receiver(host, port, ["dog"])


def test_closing_twice_lets_go_of_the_thread_and_the_port():
    receiver = Receiver("127.0.0.1", 0, ["dog"])
    receiver.close()
    receiver.close()
    assert not receiver._thread.is_alive()
    Receiver("127.0.0.1", receiver.port, ["dog"]).close()
