import json
import os
import signal
import socket
import stat
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from safetensors.numpy import save

from skydog import arrays, files
from skydog.arrays import load_arrays, save_arrays
from skydog.errors import Refusal

ARRAYS = {
    "positions": np.arange(12, dtype=np.float32).reshape(3, 2, 2),
    "flags": np.array([True, False]),
    "count": np.array([7, -7], np.int32),
}
CARD = {"kind": "thing", "name": "ovis", "list": [1, 2.5, None], "deep": {"a": True}}


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "a thing.safetensors"
    save_arrays(path, ARRAYS, CARD)
    return path


def refusal(path, **options) -> str:
    with pytest.raises(Refusal) as caught:
        load_arrays(path, "thing", **options)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def test_arrays_and_card_come_back_as_they_were_written(saved):
    arrays, card = load_arrays(saved, "thing")
    assert card == CARD
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        assert np.array_equal(arrays[name], array)


kept = st.sampled_from([np.float32, np.float64, np.int32, np.uint8, np.bool_])


@given(
    kept.flatmap(
        lambda dtype: hnp.arrays(
            dtype,
            hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
            elements={"allow_nan": False, "allow_infinity": False}
            if np.dtype(dtype).kind == "f"
            else None,
        )
    )
)
def test_an_array_of_any_shape_comes_back_in_that_shape(tmp_path_factory, array):
    path = tmp_path_factory.getbasetemp() / "any"
    save_arrays(path, {"x": array}, CARD)
    back = load_arrays(path, "thing")[0]["x"]
    assert (back.shape, back.dtype) == (array.shape, array.dtype)
    assert np.array_equal(back, array)


def test_arrays_in_another_memory_order_come_back_with_the_same_elements(tmp_path):
    array = np.arange(12.0).reshape(3, 4)
    save_arrays(tmp_path / "x", {"turned": array.T, "sliced": array[:, ::2]}, CARD)
    arrays, _ = load_arrays(tmp_path / "x", "thing")
    assert np.array_equal(arrays["turned"], array.T)
    assert np.array_equal(arrays["sliced"], array[:, ::2])


@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.5, 0.9, 0.99])
def test_a_truncated_file_is_refused_and_left_as_it_was(saved, share):
    part = saved.read_bytes()[: int(share * saved.stat().st_size)]
    saved.write_bytes(part)
    assert "damaged" in refusal(saved)
    assert saved.read_bytes() == part


@given(st.binary(max_size=200))
def test_random_bytes_are_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "random"
    path.write_bytes(content)
    refusal(path)


@given(st.integers(0, 10_000), st.integers(1, 255))
def test_a_file_with_one_wrong_byte_is_read_or_refused_and_nothing_else(
    tmp_path_factory, place, change
):
    path = tmp_path_factory.getbasetemp() / "flipped"
    save_arrays(path, ARRAYS, CARD)
    content = bytearray(path.read_bytes())
    content[place % len(content)] ^= change
    path.write_bytes(content)
    try:
        arrays, _ = load_arrays(path, "thing")
    except Refusal:
        return
    for array in arrays.values():
        assert array.dtype.kind != "f" or np.all(np.isfinite(array))


@pytest.mark.parametrize("length", [2**63, 2**64 - 1, 10**9, 0])
def test_a_header_of_absurd_length_is_refused(saved, length):
    saved.write_bytes(struct.pack("<Q", length) + saved.read_bytes()[8:])
    assert "damaged" in refusal(saved)


@pytest.mark.parametrize(
    "metadata",
    [
        None,
        {"format": "pt"},
        {arrays.CARD: "not json"},
        {arrays.CARD: "[1]"},
        {arrays.CARD: "7"},
        {arrays.CARD: '"thing"'},
        {arrays.CARD: "[" * 100_000},
        {arrays.CARD: '{"kind": ["thing"]}'},
        {arrays.CARD: '{"kind": "thing", "speed": NaN}'},
        {arrays.CARD: '{"kind": "thing", "speed": Infinity}'},
    ],
)
def test_a_foreign_file_or_one_with_a_senseless_card_is_refused(tmp_path, metadata):
    path = tmp_path / "foreign"
    path.write_bytes(save({"x": np.zeros(2)}, metadata=metadata))
    refusal(path)


@pytest.mark.parametrize("header", ["[]", "7", "{}", '{"__metadata__": []}', "null"])
def test_a_header_that_is_no_table_is_refused(tmp_path, header):
    path = tmp_path / "odd"
    path.write_bytes(struct.pack("<Q", len(header)) + header.encode())
    refusal(path)


def test_another_kind_is_refused_by_its_name(tmp_path):
    path = tmp_path / "x"
    save_arrays(path, ARRAYS, {"kind": "trace"})
    assert "trace" in refusal(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_refused_by_the_name_of_its_array(tmp_path, bad):
    path = tmp_path / "x"
    save_arrays(path, {"fine": np.zeros(2), "rotten": np.array([1.0, bad])}, CARD)
    assert "rotten" in refusal(path)


def test_a_file_larger_than_its_kind_can_be_is_refused_unread(saved):
    assert "100" in refusal(saved, largest=100)


def test_a_folder_and_a_missing_file_are_refused(tmp_path):
    assert "folder" in refusal(tmp_path)
    assert "check the path" in refusal(tmp_path / "nowhere" / "x")


def test_a_pipe_is_refused_unread_since_reading_it_may_never_end(tmp_path, monkeypatch):
    def endless(path):
        raise AssertionError(f"{path} was read")

    monkeypatch.setattr(Path, "read_bytes", endless)
    os.mkfifo(tmp_path / "pipe")
    refusal(tmp_path / "pipe")


def no_partial_files(folder) -> bool:
    return all(not entry.name.startswith(".") for entry in folder.iterdir())


def test_a_write_makes_its_folder_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "new" / "folder" / "note.txt"
    files.write_text(path, "Schäferhund")
    assert path.read_text("utf-8") == "Schäferhund"
    assert [entry.name for entry in path.parent.iterdir()] == ["note.txt"]


@pytest.mark.parametrize("call", ["replace", "fsync", "fdopen"])
def test_a_write_that_fails_leaves_the_old_file_and_no_partial_one(saved, monkeypatch, call):
    before = saved.read_bytes()

    def disk_full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, disk_full)
    with pytest.raises(Refusal, match="No space left on device"):
        save_arrays(saved, ARRAYS, {**CARD, "name": "other"})
    monkeypatch.undo()
    assert saved.read_bytes() == before
    assert no_partial_files(saved.parent)


def test_an_interrupted_write_leaves_the_old_file_and_no_partial_one(saved, monkeypatch):
    before = saved.read_bytes()

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_arrays(saved, {}, CARD)
    assert saved.read_bytes() == before
    assert no_partial_files(saved.parent)


def test_a_card_that_is_no_json_leaves_the_old_file(saved):
    before = saved.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        save_arrays(saved, ARRAYS, {"kind": "thing", "speed": float("nan")})
    assert saved.read_bytes() == before


def test_a_folder_below_a_file_is_refused(saved):
    with pytest.raises(Refusal, match="choose another folder"):
        files.write_bytes(saved / "below" / "x", b"")


def test_a_file_where_a_folder_stands_is_refused(tmp_path):
    (tmp_path / "here").mkdir()
    with pytest.raises(Refusal, match="here"):
        files.write_bytes(tmp_path / "here", b"x")
    assert no_partial_files(tmp_path)


def test_an_unwritable_folder_is_refused(tmp_path, monkeypatch):
    # Root may write anywhere, so the system is made to say no.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(Refusal, match="permission denied"):
        files.write_bytes(tmp_path / "x", b"")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", ["fifo", "socket", "folder"])
def test_what_is_no_file_is_not_written_over(tmp_path, make):
    path = tmp_path / "node"
    if make == "fifo":
        os.mkfifo(path)
    elif make == "folder":
        path.mkdir()
    else:
        with closing(socket.socket(socket.AF_UNIX)) as listener:
            listener.bind(str(path))
    before = path.lstat()
    for write in (lambda: files.write_bytes(path, b"x"), lambda: files.may_write(path)):
        with pytest.raises(Refusal, match="node"):
            write()
    assert (path.lstat().st_mode, path.lstat().st_ino) == (before.st_mode, before.st_ino)
    assert no_partial_files(tmp_path)


def test_a_device_is_not_written_over(tmp_path):
    node = tmp_path / "node"
    try:
        os.mknod(node, stat.S_IFCHR | 0o666, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("only root makes devices")
    with pytest.raises(Refusal, match="a device"):
        files.write_bytes(node, b"x")
    assert stat.S_ISCHR(node.lstat().st_mode)


@pytest.mark.parametrize("dangles", [False, True])
def test_a_link_is_followed(tmp_path, dangles):
    target = tmp_path / "elsewhere" / "target"
    link = tmp_path / "link"
    link.symlink_to(target)
    if not dangles:
        files.write_bytes(target, b"before")
    files.write_bytes(link, b"after")
    assert link.is_symlink()
    assert target.read_bytes() == b"after"


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755, 0o4755])
def test_a_file_that_is_replaced_keeps_its_mode_but_no_new_trust(tmp_path, mode):
    path = tmp_path / "secret"
    path.write_bytes(b"before")
    path.chmod(mode)
    files.write_bytes(path, b"after")
    assert stat.S_IMODE(path.stat().st_mode) == mode & 0o777


@pytest.mark.parametrize("length", [249, 250, 255])
def test_a_name_as_long_as_names_may_be_is_written(tmp_path, length):
    files.write_bytes(tmp_path / ("n" * length), b"x")
    assert [len(entry.name) for entry in tmp_path.iterdir()] == [length]


def test_a_new_file_has_the_mode_that_the_user_asks_for(tmp_path):
    before = os.umask(0o027)
    try:
        files.write_bytes(tmp_path / "new", b"x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o640


def test_a_file_that_may_not_be_written_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "kept"
    path.write_bytes(b"before")
    access = os.access  # root may write anywhere
    monkeypatch.setattr(os, "access", lambda at, mode: Path(at) != path and access(at, mode))
    with pytest.raises(Refusal, match="permission denied"):
        files.write_bytes(path, b"after")
    assert path.read_bytes() == b"before"


WRITES = """
import os, signal, sys
from pathlib import Path
from skydog import arrays, files
os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)
files.write_bytes(Path(sys.argv[1]), b"half")
"""


def test_what_a_kill_left_half_written_is_gone_after_the_next_write(tmp_path):
    path = tmp_path / "note"
    killed = subprocess.run([sys.executable, "-c", WRITES, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert not path.exists()
    assert len(list(tmp_path.iterdir())) == 1
    files.write_bytes(path, b"whole")
    assert [(entry.name, entry.read_bytes()) for entry in tmp_path.iterdir()] == [
        ("note", b"whole")
    ]


def test_writers_of_one_file_do_not_mix_their_contents(tmp_path):
    path = tmp_path / "shared"
    contents = [bytes([65 + writer]) * 100_000 for writer in range(8)]

    def write(content):
        for _ in range(10):
            files.write_bytes(path, content)

    with ThreadPoolExecutor(len(contents)) as pool:
        list(pool.map(write, contents))
    assert path.read_bytes() in contents
    assert no_partial_files(tmp_path)


@pytest.mark.parametrize("trap", ["symlink", "link"])
def test_a_trap_where_the_partial_file_would_stand_is_not_written_to(tmp_path, trap):
    victim = tmp_path / "victim"
    victim.write_bytes(b"precious")
    partial = tmp_path / ".note.part"
    partial.symlink_to(victim) if trap == "symlink" else partial.hardlink_to(victim)
    with pytest.raises(Refusal):
        files.write_bytes(tmp_path / "note", b"x")
    assert victim.read_bytes() == b"precious"


@pytest.mark.parametrize("name", ["a" * 300, "with\0nul"])
@pytest.mark.parametrize(
    "use",
    [
        lambda path: files.write_bytes(path, b"x"),
        files.may_write,
        files.folder,
        lambda path: load_arrays(path, "thing"),
    ],
)
def test_a_path_that_cannot_be_is_refused_and_named(tmp_path, name, use):
    with pytest.raises(Refusal, match=name[:4]):
        use(tmp_path / name)


def test_plain_values_are_those_that_json_gives_back():
    value = {"a": (1, 2.5, [None, True]), 3: "x", "nan": float("nan"), "deep": {"inf": -np.inf}}
    assert files.plain(value) == json.loads(json.dumps(files.plain(value), allow_nan=False))
    assert files.plain(value) == {
        "a": [1, 2.5, [None, True]],
        "3": "x",
        "nan": None,
        "deep": {"inf": None},
    }
