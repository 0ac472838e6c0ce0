"""The standard streams of the command, whatever they are connected to.

A terminal or a file may know fewer letters than we write, a pipe may be closed by its reader, and
a disk may be full. None of that may cost a result.
"""

import codecs
import os
import sys
import unicodedata
from typing import Any

CLOSED = 141  # what a shell says of a program whose reader has gone: 128 + SIGPIPE
FAILED = 1
WORDS = {"±": "+-", "×": "x", "÷": "/", "√": "sqrt", "→": "->", "≥": ">=", "≤": "<=", "·": "."}
DASHES = "—–−‑╌─━═╴╶╸╺"
BARS = "│┃║╎╵╷▏"


def own() -> None:
    """Take the standard streams over: from now on, writing to them never fails for a letter.

    What is told about the work, on the standard error, never stops the work either.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: else the next file that is opened would stand in its place
            os.open(os.devnull, os.O_RDWR)
    codecs.register_error("skydog", _plainer)
    sys.stdout = _spelled(sys.stdout, 1)
    sys.stderr = _Lenient(_spelled(sys.stderr, 2))


def finish(code: int) -> int:
    """The exit code, once everything is written; another one if it could not be."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        return broken()
    except OSError as problem:
        return failed(problem)
    return code


def broken() -> int:
    """The exit code when the reader of the results has gone."""
    _give_up()
    return CLOSED


def failed(problem: OSError) -> int:
    """The exit code when the results cannot be written, which is said."""
    _give_up()
    print(f"skydog: cannot write the results: {problem.strerror}", file=sys.stderr)
    return FAILED


def _give_up() -> None:
    """Write what is left to nowhere: else the interpreter complains of it when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def _spelled(stream: Any, number: int) -> Any:
    if stream is None:
        return open(number, "w", errors="skydog", closefd=False)
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="skydog")
    return stream


def _plainer(problem: UnicodeError) -> tuple[str | bytes, int]:
    """Letters that the encoding lacks, in letters that every encoding has."""
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    first = problem.object[problem.start]
    if "\udc80" <= first <= "\udcff":  # a byte of a file's name that is no UTF-8
        return bytes([ord(first) - 0xDC00]), problem.start + 1
    return _plain(first), problem.start + 1


def _plain(letter: str) -> str:
    if letter in WORDS:
        return WORDS[letter]
    if letter in DASHES or letter in BARS:
        return "-" if letter in DASHES else "|"
    name = unicodedata.name(letter, "")
    if name.startswith("BOX DRAWINGS"):
        return "+"
    if name.startswith("GREEK"):
        return name.split()[-1].lower()
    alike = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    return alike or "?"


class _Lenient:
    """A stream to which nobody need listen."""

    def __init__(self, stream: Any):
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            return
