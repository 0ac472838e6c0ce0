"""The one exception that a user is meant to read."""


class Refusal(ValueError):
    """A wrong input. The message names the bad value and the remedy, in one line."""
