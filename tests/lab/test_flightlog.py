import errno
import os
import time
from typing import Any

import jax
import numpy as np
import pytest

pytest.importorskip("mcap", reason="the lab's packages are not installed: skydog[lab]")
pytest.importorskip("rosbags", reason="the lab's packages are not installed: skydog[lab]")

from flightlogs import CARD, DOGS, FLIGHT, PATIENCE, SHEEP, decisions, flown, fly, read, written
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from skydog.commands.replay import replay
from skydog.errors import Refusal
from skydog.flight.supervisor import Mode
from skydog.lab import bag, flightlog
from skydog.lab.flightlog import FlightLog
from skydog.lab.messages import store2
from skydog.lab.playback import Playback
from skydog.world import serialise
from skydog.world import trace as traces


@pytest.fixture
def logged(tmp_path):
    return written(tmp_path / "flight-one")


def same(one, other):
    assert serialise.flatten(one.world) == serialise.flatten(other.world)
    here, there = (jax.tree.leaves(trace) for trace in (one, other))
    for mine, yours in zip(here, there, strict=True):
        np.testing.assert_array_equal(mine, yours)


@pytest.mark.parametrize("name", [".", "flight-one_0.mcap"])
def test_a_mission_comes_back_from_its_log_exactly(logged, name):
    back, shepherd = flightlog.load(logged / name)
    assert shepherd == "a rule dog"
    same(back, flown())


def test_a_mission_from_a_log_is_a_trace_file_like_any_other(logged, tmp_path):
    traces.save(tmp_path / "t.safetensors", *flightlog.load(logged))
    same(traces.load(tmp_path / "t.safetensors")[0], flown())


def test_of_several_cases_the_last_is_read_or_the_one_that_is_named(tmp_path):
    log = FlightLog(tmp_path / "flight", "", CARD, FLIGHT)
    fly(log, case=4)
    log.ended(4, "left the cage", 30, time.monotonic())
    fly(log, case=2)
    log.close()
    endings = [
        traces.how_it_ended(flightlog.load(tmp_path / "flight", case)[0]) for case in (None, 2, 4)
    ]
    assert endings == ["accomplished", "accomplished", "left the cage"]
    with pytest.raises(Refusal, match="case 3"):
        flightlog.load(tmp_path / "flight", 3)


def test_a_mission_whose_log_breaks_off_was_stopped(tmp_path):
    log = FlightLog(tmp_path / "flight", "", CARD, FLIGHT)
    for decision in list(decisions())[:3]:
        log.decision(decision, time.monotonic())
    log.close()
    back, _ = flightlog.load(tmp_path / "flight")
    assert len(back.time) == 3
    assert traces.how_it_ended(back) == "stopped by the supervisor"


def test_rosbags_reads_every_topic_by_the_definitions_in_the_file(logged):
    with AnyReader([logged]) as reader:
        found = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
        last: dict[str, Any] = {
            c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()
        }
    poses = {f"/{n}/{what}": flightlog.POSE for n in (*DOGS, *SHEEP) for what in ("pose", "seen")}
    commands = {f"/{n}/cmd": flightlog.TWIST for n in (*DOGS, *SHEEP)}
    once = dict.fromkeys(("/site", "/sheepdog", "/mission"), flightlog.STRING)
    ours = {
        "/decision": flightlog.DECISION,
        "/ending": flightlog.ENDING,
        "/supervisor": flightlog.SUPERVISOR,
        "/timing": flightlog.TIMING,
        "/events": flightlog.LOG,
    }
    assert {topic: kind for topic, (kind, _) in found.items()} == poses | commands | once | ours
    assert all(found[topic][1] == 1 for topic in once)
    assert last["/site"].data == "[mission]\n"
    assert last["/ugv1/cmd"].header.frame_id == "ugv1"
    assert last["/uav1/cmd"].header.frame_id == "world"
    assert last["/supervisor"].mode == Mode.LANDING
    assert last["/events"].msg == "landed"


def test_the_mcap_library_reads_the_same_bytes_and_finds_an_index(logged):
    """By the schemas in the file alone: no message of ours is known to that reader's store."""
    with (logged / "flight-one_0.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert len(summary.chunk_indexes) > 0
        schema, _, message = next(reader.iter_messages(topics=["/decision"]))
    assert schema is not None
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.data.decode(), "skydog_msgs/msg/Decision"))
    decision: Any = store.deserialize_cdr(message.data, "skydog_msgs/msg/Decision")
    assert decision.step == 0
    assert message.log_time == message.publish_time
    assert abs(message.log_time - time.time_ns()) < 1e9 * PATIENCE


def test_the_modes_in_the_log_are_those_of_the_supervisor():
    kind = store2().types[flightlog.SUPERVISOR]
    assert {mode.name: getattr(kind, mode.name) for mode in Mode} == Mode.__members__


def test_a_full_disk_is_a_problem_that_can_be_read(tmp_path, monkeypatch):
    log = FlightLog(tmp_path / "flight", "", CARD, FLIGHT)

    def full(self):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(bag.Bag, "flush", full)
    deadline = time.monotonic() + PATIENCE
    while log.problem is None and time.monotonic() < deadline:
        log.event("still flying")
        time.sleep(0.02)
    assert log.problem is not None
    assert "No space left" in log.problem
    log.event("flying on")
    log.close()
    log.close()
    assert log.dropped >= 1


def test_what_cannot_be_written_is_a_problem_and_never_an_error(tmp_path):
    log = FlightLog(tmp_path / "flight", "", CARD, FLIGHT)
    log.ended(-1, "accomplished", 10, time.monotonic())
    log.close()
    assert log.problem is not None


def test_a_log_is_never_written_over_another(logged):
    with pytest.raises(Refusal, match="is there already"):
        FlightLog(logged, "", CARD, FLIGHT)


def test_a_queue_that_is_full_drops_and_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(flightlog, "LONGEST_QUEUE", 5)
    monkeypatch.setattr(flightlog, "PERIOD", PATIENCE)
    log = FlightLog(tmp_path / "flight", "", CARD, FLIGHT)
    for number in range(12):
        log.event(f"{number}")
    log.close()
    assert log.dropped == 7
    told = [event.msg for event in read(tmp_path / "flight", "/events")]
    assert told == ["0", "1", "2", "3", "4", "7 messages were dropped"]


def test_a_log_of_nothing_is_no_mission_and_no_tracker(tmp_path):
    log = FlightLog(tmp_path / "flight", "", CARD, FLIGHT)
    log.close()
    with pytest.raises(Refusal, match="no poses of a tracker"):
        Playback(tmp_path / "flight")
    with pytest.raises(Refusal, match="no mission"):
        flightlog.load(tmp_path / "flight")


def test_a_flight_log_is_replayed_like_a_trace(logged, tmp_path, capsys):
    assert replay((logged,), tmp_path / "replay.html") == 0
    assert "flight-one" in (tmp_path / "replay.html").read_text()
