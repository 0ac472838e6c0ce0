"""The command line, run in this process."""

import sys

import pytest

from skydog import cli


@pytest.fixture
def skydog(monkeypatch, capsys, tmp_path):
    """The command, run in this process and in an empty folder: exit code, output, errors."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str):
        monkeypatch.setattr(sys, "argv", ["skydog", *arguments])
        with pytest.raises(SystemExit) as left:
            cli.main()
        told = capsys.readouterr()
        return left.value.code or 0, told.out, told.err

    return run


@pytest.fixture
def refused(skydog, tmp_path):
    """What a command that must be refused says; it may write nothing."""

    def run(*arguments: str) -> str:
        before = {p: p.read_bytes() if p.is_file() else None for p in tmp_path.rglob("*")}
        code, out, err = skydog(*arguments)
        assert code == 2
        assert out == ""
        assert err.startswith("skydog: ")
        assert err.count("\n") == 1
        after = {p: p.read_bytes() if p.is_file() else None for p in tmp_path.rglob("*")}
        assert after == before
        return err

    return run
