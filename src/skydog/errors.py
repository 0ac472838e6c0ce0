"""The one exception that a user is meant to read, and how text of others is shown."""

import reprlib
from typing import Any

LONGEST = 600  # characters of a line
_REPR = reprlib.Repr()
_REPR.maxother = _REPR.maxstring = 57


class Refusal(ValueError):
    """A wrong input. The message names the bad value and the remedy, in one line."""

    def __init__(self, message: object = ""):
        super().__init__(one_line(str(message)))


def one_line(text: str) -> str:
    """Text for a terminal: one line of bounded length, and no character that steers it.

    Text of a file, or the name of one, may hold anything. What is too long loses its middle: the
    bad value stands at the beginning of a message, and the remedy at the end.
    """
    if len(text) > LONGEST:
        text = f"{text[: LONGEST - 203]} … {text[-200:]}"
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode()
        for letter in text
    )


def short(value: Any) -> str:
    """What a message shows of a bad value: one line of 60 characters at most, and no failure."""
    try:
        text = " ".join(_REPR.repr(value).split())
    except Exception:  # an integer of more than 4300 digits, or an object that cannot say
        text = f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= 60 else text[:57] + "..."
