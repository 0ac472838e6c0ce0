"""`skydog presets`: the named worlds and their values."""

import json

from skydog.commands.flags import Json


def presets(as_json: Json = False) -> int:
    """List the presets: worlds with names, and their values in SI units.

    Example: skydog presets --json

    Args:
        as_json: Print them as JSON instead of a table.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Column, Table

    from skydog.commands import console
    from skydog.world import presets, serialise

    values = {name: serialise.flatten(presets.preset(name)) for name in presets.PRESETS}
    if as_json:
        print(json.dumps(values, indent=2))
        return 0
    table = Table(
        Column("", no_wrap=True),
        *(Column(name, overflow="fold") for name in values),
        title="Presets, for 3 sheep (metres, seconds, m/s)",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )
    names = dict.fromkeys(name for preset in values.values() for name in preset)
    for name in sorted(names, key=lambda name: name.split(".")[0] != "flock"):
        table.add_row(name, *(_short(preset.get(name, "—")) for preset in values.values()))
    console.print_table(table)
    for name, preset in presets.PRESETS.items():
        print(f"{name}: {(preset.__doc__ or name).splitlines()[0]}")
    return 0


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
