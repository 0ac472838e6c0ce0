"""The one exception that a user is meant to read, and how text of others is shown."""

LONGEST = 600  # characters of a line


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
