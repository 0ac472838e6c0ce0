"""One colour for each role, wherever it is drawn: Okabe and Ito's, safe for the colour-blind."""

ROLES = {
    "sheep": "#0072B2",  # blue
    "dog": "#D55E00",  # vermilion
    "goal": "#009E73",  # bluish green
    "subgoal": "#CC79A7",  # reddish purple
    "collect": "#E69F00",  # orange
    "drive": "#56B4E9",  # sky blue
    "arena": "#808080",  # not of the palette: a frame that competes with nobody
}


def behaviour(drives: bool) -> str:
    """The colour of what a dog does: driving, else collecting."""
    return ROLES["drive" if drives else "collect"]
