"""What the command writes to, whatever it is connected to."""

import os
import pty
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from skydog.arrays import load_arrays
from skydog.commands import console, streams

SKYDOG = [sys.executable, "-m", "skydog.cli"]
HANGS = 600  # seconds


def run(*arguments, **options):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": HANGS, **options}
    return subprocess.run([*SKYDOG, *arguments], check=False, **pipes)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
@pytest.mark.parametrize("command", ["--help", "test --help", "presets"])
def test_what_the_encoding_lacks_is_spelled_out(encoding, command):
    done = run(*command.split(), env={**os.environ, "PYTHONIOENCODING": encoding})
    assert done.returncode == 0, done.stderr
    shown = done.stdout.decode(encoding)
    if encoding == "ascii" and command == "test --help":
        assert "scaled by xi" in shown
        assert "radius D in metres" in shown
    assert "??" not in shown


def test_a_run_under_the_posix_locale_ends_with_its_table(tmp_path):
    posix = {"LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    done = run("test", "strombom", "--cases", "2", env={**os.environ, **posix})
    assert done.returncode == 0, done.stderr
    assert b"+-" in done.stdout


@pytest.mark.parametrize(
    ("letters", "plain"),
    [("±×—ξ𝔻π", "+-x-xiDpi"), ("─│╭Strömbom…", "-|+Strombom..."), ("\udc80☃", "??")],
)
def test_letters_are_replaced_by_those_that_every_encoding_has(letters, plain):
    assert "".join(map(streams._plain, letters)) == plain


def test_a_reader_that_goes_ends_the_command_quietly():
    ours, theirs = os.pipe()
    os.close(ours)
    done = run("presets", "--json", stdout=theirs)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (streams.CLOSED, b"")


@pytest.mark.parametrize("command", ["presets", "presets --json"])
def test_a_full_disk_is_said_in_one_line(command):
    with Path("/dev/full").open("wb") as full:
        done = run(*command.split(), stdout=full)
    assert done.returncode == 1
    assert re.fullmatch(rb"skydog: cannot write the results: .*\n", done.stderr)


def test_nobody_need_listen_to_what_is_told_of_the_work(tmp_path):
    ours, theirs = os.pipe()
    os.close(ours)
    done = run("test", "strombom", "--cases", "1", "--out", str(tmp_path), "--json", stderr=theirs)
    os.close(theirs)
    assert done.returncode == 0
    assert (tmp_path / "results.json").exists()


def test_streams_that_are_closed_are_not_taken_for_files(tmp_path):
    command = " ".join([*SKYDOG, "test strombom --cases 1 --out", str(tmp_path), "<&- >&- 2>&-"])
    assert subprocess.run(["sh", "-c", command], check=False, timeout=HANGS).returncode == 0
    for path in tmp_path.glob("traces/*"):
        load_arrays(path, "trace")


def in_terminal(columns, *arguments):
    """What a command shows in a terminal of so many columns."""
    ours, theirs = pty.openpty()
    shown = b""
    command = [*SKYDOG, *arguments]
    environment = {**os.environ, "COLUMNS": str(columns), "TERM": "xterm"}
    with subprocess.Popen(
        command, env=environment, stdin=theirs, stdout=theirs, stderr=theirs
    ) as process:
        os.close(theirs)
        with suppress(OSError):  # which is how a terminal says that nobody writes to it any more
            while read := os.read(ours, 1 << 16):
                shown += read
    os.close(ours)
    assert process.returncode == 0
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode())


@pytest.mark.parametrize("columns", [40, 60])
def test_a_narrow_terminal_cuts_no_number(columns, capfd):
    shown = in_terminal(columns, "test", "strombom", "--cases", "2")
    assert re.search(r"steps +\d+ ± \d+ \[\d+, \d+\]", shown)
    assert "…" not in shown.partition("Each figure")[0]
    assert max(map(len, shown.splitlines())) <= columns


def test_a_wide_table_in_a_pipe_is_whole(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    table = console.Table("scenario", "steps")
    table.add_row("S" * 60, "1 ± 2\n[3, 4]")
    console.print_table(table)
    assert "S" * 60 in capsys.readouterr().out
