import signal
import subprocess
import sys
import textwrap
import zlib
from contextlib import suppress

import numpy as np
import pytest

pytest.importorskip("mcap", reason="the lab's packages are not installed: skydog[lab]")
pytest.importorskip("rosbags", reason="the lab's packages are not installed: skydog[lab]")

from flightlogs import CARD, FLIGHT, flown, read, written
from rosbags.highlevel import AnyReader

from skydog.errors import Refusal
from skydog.lab import bag, flightlog
from skydog.lab.flightlog import FlightLog
from skydog.lab.playback import Playback


@pytest.fixture
def logged(tmp_path):
    return written(tmp_path / "flight-one")


CHILD = """
    import itertools, resource, signal, sys, time
    from pathlib import Path
    from skydog.lab.flightlog import Flight, FlightLog
    from skydog.world.presets import preset

    flight = Flight("nobody", preset("paper-w05", 4.0), ("uav1",), ("ugv1",), 9)

    def fly(folder, until):
        log = FlightLog(Path(folder), "", {}, flight)
        for number in itertools.count():
            log.pose("uav1", (float(number), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), time.monotonic())
            if number % 10 == 0:
                print(number, log.problem or "", sep=";", flush=True)
            if until(log):
                log.close()
                return
            time.sleep(0.01)

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, hard))
    fly(sys.argv[1], lambda log: log.dropped > 30)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    print(flush=True)
    fly(sys.argv[2], lambda log: False)
"""


class Child:
    """A process that flew with a full disk, flew again, and was killed."""

    def __init__(self, folder):
        self.full, self.killed = folder / "full", folder / "killed"
        command = [sys.executable, "-c", textwrap.dedent(CHILD), str(self.full), str(self.killed)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as flying:
            assert flying.stdout is not None
            lines = (line.strip().split(";") for line in flying.stdout)
            self.problems = [line[1] for line in iter(lines.__next__, [""])]
            self.told = next(int(line[0]) for line in lines if int(line[0]) >= 160)  # of its poses
            flying.send_signal(signal.SIGKILL)


@pytest.fixture(scope="module")
def child(tmp_path_factory):
    return Child(tmp_path_factory.mktemp("child"))


def poses_of(path):
    """The numbers that the child gave to its poses."""
    return [message.pose.position.x for message in read(path, "/uav1/pose")]


def test_a_log_killed_in_flight_loses_at_most_its_last_second(child):
    with pytest.raises(Exception, match="magic"), AnyReader([child.killed]):
        pass
    kept = poses_of(child.killed)
    assert child.told - 100 <= kept[-1]  # a hundred a second
    assert kept == list(range(len(kept)))
    flightlog.recover(child.killed)
    assert poses_of(child.killed) == kept
    with AnyReader([child.killed]) as reader:
        assert reader.message_count == len(kept) + 3
    names = sorted(found.name for found in child.killed.iterdir())
    assert names == ["killed_0.mcap", "metadata.yaml"]


def test_a_full_disk_ends_the_log_and_not_the_flight(child):
    assert child.problems[0] == ""
    assert "File too large" in child.problems[-1]
    kept = poses_of(child.full)
    assert kept
    assert kept == list(range(len(kept)))
    flightlog.recover(child.full)
    with AnyReader([child.full]) as reader:
        assert reader.message_count == len(kept) + 3


def test_a_log_that_is_being_written_is_not_recovered(tmp_path):
    log = FlightLog(tmp_path / "flight", "", CARD, FLIGHT)
    with pytest.raises(Refusal, match="being written"):
        flightlog.recover(tmp_path / "flight")
    log.close()


def test_a_log_that_was_closed_is_not_changed_by_recovering(logged):
    before = bag.find(logged).read_bytes()
    (logged / bag.METADATA).unlink()
    flightlog.recover(logged)
    assert bag.find(logged).read_bytes() == before
    with AnyReader([logged]) as reader:
        assert reader.message_count > 0


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "does not begin"),
        (b"not an mcap at all", "does not begin"),
        (bag.MCAP0_MAGIC, "no mission"),
        (bag.MCAP0_MAGIC + b"\x06" + b"\xff" * 8 + b"x" * 50, "no mission"),
        (bag.MCAP0_MAGIC + b"\x00" * 4000, "no mission"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path, content, why):
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    with pytest.raises(Refusal, match=why):
        flightlog.load(path)
    with pytest.raises(Refusal):
        flightlog.recover(path)
    with pytest.raises(Refusal):
        Playback(path)
    assert path.read_bytes() == content


def test_a_folder_without_a_log_and_a_path_to_nothing_are_refused(tmp_path):
    with pytest.raises(Refusal, match=r"holds 0 \.mcap files"):
        flightlog.load(tmp_path)
    with pytest.raises(Refusal, match="no such file"):
        flightlog.load(tmp_path / "gone.mcap")


def test_a_file_larger_than_any_log_is_refused_unread(tmp_path):
    path = tmp_path / "huge.mcap"
    with path.open("wb") as file:
        file.truncate(bag.LARGEST + 1)
    with pytest.raises(Refusal, match="more than any flight log"):
        flightlog.load(path)


def _sealed(content):
    """The file with the check sums of its chunks made anew, so that damage gets through them."""
    content, at = bytearray(content), len(bag.MCAP0_MAGIC)
    while at + 9 < len(content):
        size = int.from_bytes(content[at + 1 : at + 9], "little")
        if content[at] == 6 and at + 9 + size <= len(content):
            body = at + 9
            name = int.from_bytes(content[body + 28 : body + 32], "little")
            start = body + 32 + name + 8
            checksum = zlib.crc32(content[start : body + size])
            content[body + 24 : body + 28] = checksum.to_bytes(4, "little")
        at += 9 + size
    return bytes(content)


def _in_chunks(folder, path):
    """The log, a chunk for every ten messages, as one that was written for longer."""
    log = bag.Bag(path)
    for number, (topic, when, data) in enumerate(bag.messages(bag.find(folder))):
        log.add(topic)
        log.write(topic.name, when, data)
        if number % 10 == 0:
            log.flush()
    log.close()
    return path.read_bytes()


@pytest.mark.parametrize("damage", ["cut", "flipped", "flipped and sealed"])
def test_a_damaged_log_is_read_up_to_the_damage_or_refused(logged, tmp_path, damage):
    draw = np.random.default_rng(3)
    whole = _in_chunks(logged, tmp_path / "whole.mcap")
    path = tmp_path / "damaged.mcap"
    whole_enough, sheep = 0, np.asarray(flown().sheep)
    for _ in range(100):
        content = bytearray(whole)
        if damage == "cut":
            del content[draw.integers(len(content)) :]
        else:
            for place in draw.integers(len(content), size=3):
                content[place] ^= 1 << draw.integers(8)
        path.write_bytes(_sealed(content) if damage.endswith("sealed") else content)
        with suppress(Refusal):
            back, _ = flightlog.load(path)
            whole_enough += 1
            if damage == "cut":
                np.testing.assert_array_equal(back.sheep, sheep[: len(back.time)])
        with suppress(Refusal):
            seen = Playback(path, fast=True)
            while seen.wait(0.0):
                seen.bodies()
            seen.close()
    assert whole_enough > 0
