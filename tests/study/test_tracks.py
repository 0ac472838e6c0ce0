"""Files of tracks: ours, and the layout of Jadhav et al. 2024, made here."""

import zlib

import numpy as np
import pytest
from scipy import io as matlab

from skydog.errors import Refusal
from skydog.study import tracks
from skydog.study.tracks import Event, Piece


def walk(instants, sheep=3, dogs=1, seed=0, step=0.5, begin=0.0):
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(instants, sheep + dogs, 2))
    places = np.cumsum(np.rint(64 * steps) / 64, axis=0)
    time = begin + step * np.arange(instants)
    return Piece(time, places[:, :sheep], places[:, sheep:])


def assert_same(found, expected):
    assert [event.name for event in found] == [event.name for event in expected]
    for a, b in zip(found, expected, strict=True):
        assert len(a.pieces) == len(b.pieces)
        for one, other in zip(a.pieces, b.pieces, strict=True):
            np.testing.assert_allclose(one.time - one.time[0], other.time - other.time[0])
            np.testing.assert_allclose(one.sheep, other.sheep)
            np.testing.assert_allclose(one.dogs, other.dogs)


# Our layout


def test_tracks_that_are_written_come_back(tmp_path):
    events = [
        Event("north", [walk(5, 3, 2), walk(4, 3, 2, seed=1, begin=60.0)]),
        Event("south", [walk(6, 3, 2, seed=2)]),
    ]
    tracks.write(tmp_path / "tracks.csv", events)
    assert_same(tracks.read(tmp_path / "tracks.csv"), events)


def test_rows_and_columns_may_stand_in_any_order_and_ids_may_be_names(tmp_path):
    lines = [
        f"{x},{time},{name},{y},{kind}"
        for time in (0.0, 0.1, 0.2)
        for kind, name, x, y in (
            ("dog", "Rex", 5 + time, 1),
            ("Sheep", "b", 2, time),
            ("sheep", "a", 1, 3),
        )
    ]
    order = np.random.default_rng(0).permutation(len(lines))
    text = "\ufeffx,time,id,y,kind\n" + "\n".join(lines[at] for at in order) + "\n\n"
    (tmp_path / "t.csv").write_text(text)
    ((piece,),) = (event.pieces for event in tracks.read(tmp_path / "t.csv"))
    np.testing.assert_allclose(piece.time, [0.0, 0.1, 0.2])
    np.testing.assert_allclose(piece.dogs[:, 0], [[5, 1], [5.1, 1], [5.2, 1]])
    by_x = piece.sheep[:, np.argsort(piece.sheep[0, :, 0])]
    np.testing.assert_allclose(by_x[2], [[1, 3], [2, 0.2]])


def test_an_instant_at_which_somebody_was_not_seen_parts_two_pieces(tmp_path):
    piece = walk(10)
    piece.sheep[4, 1] = np.nan
    tracks.write(tmp_path / "t.csv", [Event("1", [piece])])
    (event,) = tracks.read(tmp_path / "t.csv")
    assert [len(one.time) for one in event.pieces] == [4, 5]
    assert event.pieces[1].time[0] == 2.5


HEAD = "time,kind,id,x,y\n"
ROWS = "0,sheep,1,0,0\n0,dog,1,1,1\n1,sheep,1,0,1\n1,dog,1,1,1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column 'time'"),
        ("time,kind,id,x\n", "no column 'y'"),
        ("time,kind,id,x,x,y\n", "no column 'x'"),
        (HEAD, "no two instants"),
        (HEAD + "0,sheep,1,0,0\n0,dog,1,1,1\n", "no two instants"),
        (HEAD + "0,wolf,1,0,0\n", "line 2: 'wolf' is no kind; write sheep or dog"),
        (HEAD + "0,sheep,1,0\n", "line 2: 4 columns, not 5"),
        (HEAD + "0,sheep,1,zero,0\n", "line 2: 'zero' is no number"),
        (HEAD + "0,sheep,1,inf,0\n", "line 2: 'inf' is no number"),
        (HEAD + "0,sheep,1,1e9,0\n", "line 2: '1e9' is no number"),
        (HEAD + ROWS.replace("dog", "sheep", 0) + "0,sheep,1,0,0\n", "twice at one time"),
        (HEAD + ROWS.replace("dog,1", "sheep,2"), "no dog in the event '1'"),
    ],
)
def test_a_file_of_no_tracks_is_refused_by_its_line(tmp_path, text, said):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(Refusal) as refusal:
        tracks.read(tmp_path / "t.csv")
    assert said in str(refusal.value)


def test_two_flocks_in_one_file_are_refused(tmp_path):
    tracks.write(tmp_path / "t.csv", [Event("a", [walk(4, 3)]), Event("b", [walk(4, 5)])])
    with pytest.raises(Refusal, match="5 sheep in the event 'b', and 3 in the first"):
        tracks.read(tmp_path / "t.csv")


@pytest.mark.parametrize("name", ["t.txt", "t.csv", "t.mat", "folder.csv"])
def test_what_cannot_be_read_is_refused(tmp_path, name):
    (tmp_path / "folder.csv").mkdir()
    if name == "t.csv":
        (tmp_path / name).write_bytes(b"\xff\xfe\x00time")
    if name == "t.mat":
        (tmp_path / name).write_bytes(b"MATLAB 7.3 MAT-file" + bytes(2000))
    with pytest.raises(Refusal, match=name):
        tracks.read(tmp_path / name)


# Windows


def test_windows_interpolate_and_never_cross_a_gap():
    first, second = walk(9, step=0.5), walk(5, seed=1, step=0.5, begin=100.0)
    events = [Event("a", [first, second]), Event("b", [walk(2)])]
    found = tracks.windows(events, 1.0, 3)
    assert found.event.tolist() == [0, 0, 0, 0]  # 5 instants give 3 windows, 3 give 1, 1 none
    np.testing.assert_allclose(found.sheep[1], first.sheep[[2, 4, 6]])
    np.testing.assert_allclose(found.dogs[3], second.dogs[[0, 2, 4]])
    half = tracks.windows(events, 0.25, 3)
    np.testing.assert_allclose(half.sheep[0, 1], (first.sheep[0] + first.sheep[1]) / 2)


def test_tracks_shorter_than_a_window_are_refused():
    with pytest.raises(Refusal, match="no stretch of 6 instants 1 s apart"):
        tracks.windows([Event("a", [walk(9, step=0.5)])], 1.0, 6)


@pytest.mark.parametrize(
    ("events", "lengths"),
    [
        ([Event("a", [walk(24)])], [4] * 6),
        ([Event("a", [walk(4), walk(5)]), Event("b", [walk(6)])], [4, 5, 6]),
        ([Event(str(n), [walk(4), walk(4)]) for n in range(3)], [8, 8, 8]),
    ],
)
def test_fewer_than_three_events_are_parted(events, lengths):
    found = tracks.parts(events)
    assert [sum(len(piece.time) for piece in event.pieces) for event in found] == lengths


# The layout of Jadhav et al. 2024: 14 sheep, the dog, the shepherd, every 0.1 s


def trial(instants, seed):
    return walk(instants, tracks.JADHAV_SHEEP, 2, seed, step=0.1)  # the second is the shepherd


def sheep_and_dog(piece, rows=slice(None)):
    time = piece.time[rows]
    return Piece(time - time[0], piece.sheep[rows], piece.dogs[rows, :1])


@pytest.mark.parametrize("head", ["", '"event" "id" "time" "x" "y"\n'])
@pytest.mark.parametrize("by", [" ", ",", "\t"])
def test_sheepr_dat_is_read_trial_by_trial(tmp_path, head, by):
    trials = {1: trial(6, 0), 3: trial(4, 1)}
    lines = [
        by.join(map(str, (number, tag + 1, round(time, 3), *places[row, tag])))
        for number, piece in trials.items()
        for places in [np.concatenate([piece.sheep, piece.dogs], axis=1)]
        for tag in range(16)
        for row, time in enumerate(piece.time)
    ]
    (tmp_path / "sheepR.dat").write_text(head + "\n".join(lines))
    expected = [Event(str(number), [sheep_and_dog(piece)]) for number, piece in trials.items()]
    assert_same(tracks.read(tmp_path / "sheepR.dat"), expected)


@pytest.mark.parametrize(
    ("line", "said"),
    [("1 1 0 0", "line 1: 4 columns"), ("1 17 0 0 0", "no tag has the number 17")],
)
def test_another_dat_file_is_refused(tmp_path, line, said):
    (tmp_path / "t.dat").write_text(line)
    with pytest.raises(Refusal, match=said):
        tracks.read(tmp_path / "t.dat")


def tags(piece):
    """Tags, x and y, instants: as MATLAB holds a trial."""
    return np.moveaxis(np.concatenate([piece.sheep, piece.dogs], axis=1), 0, -1)


@pytest.mark.parametrize("packed", [False, True])
def test_drives_data_is_read_drive_by_drive(tmp_path, packed):
    one, two = trial(12, 0), trial(5, 1)
    matlab.savemat(
        tmp_path / "drives_data.mat",
        {
            "events": [[2, 6]], "dt": 0.1, "no_ind": 16,
            # The first trial has drives of 7 and 5 instants; positions are numbered by place.
            "ev_st_2": [[1400.0, 4530.0]], "ev_et_2": [[1406.0, 4534.0]], "pos_ev_1": tags(one),
            "ev_st_6": [[810.0]], "ev_et_6": [[814.0]], "pos_ev_2": tags(two),
        },
        do_compression=packed,
    )  # fmt: skip
    found = tracks.read(tmp_path / "drives_data.mat")
    drives = [sheep_and_dog(one, slice(0, 7)), sheep_and_dog(one, slice(7, 12))]
    assert_same(found, [Event("2", drives), Event("6", [sheep_and_dog(two)])])


def test_sheep_all_dat_is_read_trial_by_trial(tmp_path):
    one, two = trial(6, 0), trial(5, 1)
    holds = {"no_evnts": 2, "dt": 0.1, "pos_ev_1": tags(one), "pos_ev_2": tags(two)}
    matlab.savemat(tmp_path / "sheep_all_dat.mat", holds)
    expected = [Event("1", [sheep_and_dog(one)]), Event("2", [sheep_and_dog(two)])]
    assert_same(tracks.read(tmp_path / "sheep_all_dat.mat"), expected)


@pytest.mark.parametrize("change", ["no dt", "drives too long", "few tags"])
def test_another_mat_file_is_refused_and_sheepr_dat_proposed(tmp_path, change):
    holds = {
        "events": [[1]], "dt": 0.1, "ev_st_1": [[1.0]], "ev_et_1": [[5.0]],
        "pos_ev_1": tags(trial(5, 0)),
    }  # fmt: skip
    if change == "no dt":
        del holds["dt"]
    elif change == "drives too long":
        holds["ev_et_1"] = [[6.0]]
    else:
        holds["pos_ev_1"] = tags(walk(5, 3))
    matlab.savemat(tmp_path / "t.mat", holds)
    with pytest.raises(Refusal, match=r"no drives_data\.mat .* try their sheepR\.dat"):
        tracks.read(tmp_path / "t.mat")


def test_a_mat_file_that_unpacks_to_more_than_any_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(tracks, "LARGEST", 1 << 16)
    packed = zlib.compress(bytes(1 << 20))
    element = (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed
    (tmp_path / "t.mat").write_bytes(bytes(128) + element)
    with pytest.raises(Refusal, match="more than any file of tracks"):
        tracks.read(tmp_path / "t.mat")
