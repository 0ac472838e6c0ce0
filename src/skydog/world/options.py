"""The options of a world, spelled once. Free to import."""

PRESET_NAMES = (
    "paper",
    "paper-w05",
    "paper-literal",
    "paper-physical",
    "strombom2014",
    "strombom2014-sqrt",
    "elfiqi2020",
    "lama2024",
)
"""The names of `skydog.world.presets.PRESETS`."""

SCENE_NAMES = ("gate", "corridor", "u-trap", "maze", "clutter")
"""The names of `skydog.world.scenes.SCENES`."""

KIND_NAMES = ("stubborn", "short-sighted", "loner", "noisy", "follower", "slow")
"""The names of `skydog.world.mixing.KINDS`."""
