"""No arrow runs from a lower room to a higher one, as the README's house lists them."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "skydog"
FILES = sorted(SOURCE.rglob("*.py"))


def rooms():
    """The rooms of the README's house, the highest first."""
    house = (ROOT / "README.md").read_text().split("    src/skydog/\n", 1)[1]
    return re.findall(r"^      (\w+)(?:/|\.py)\s", house.split("\n    tests/", 1)[0], re.M)


def room_of(module):
    """Where a module of skydog stands among the rooms: 0 is the highest."""
    name = module.removeprefix("skydog.").split(".")[0]
    assert name in rooms(), f"the README's house does not list {module}"
    return rooms().index(name)


def imports(file):
    """The modules of skydog that a file imports, wherever in it and for whatever reason."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file} imports relatively, in line {node.lineno}"
        named = re.fullmatch(r"skydog\.(\w+)[.\w]*", str(getattr(node, "value", "")))
        if named and ((SOURCE / named[1]).is_dir() or (SOURCE / f"{named[1]}.py").exists()):
            yield named[0]  # what import_module may be given
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "skydog":
            if node.module == "skydog":
                yield from (f"skydog.{name.name}" for name in node.names)
            else:
                yield node.module
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name.startswith("skydog"))


def test_the_house_lists_every_room_once_and_no_other():
    there = {file.relative_to(SOURCE).parts[0].removesuffix(".py") for file in FILES}
    assert sorted(rooms()) == sorted(there)


@pytest.mark.parametrize(
    "file", FILES, ids=lambda file: str(file.relative_to(SOURCE).with_suffix(""))
)
def test_a_room_imports_only_rooms_above_it(file):
    own = file.relative_to(SOURCE).parts[0].removesuffix(".py")
    if own == "__init__":
        return  # the public face shows what lives in the rooms
    for module in imports(file):
        if module == "skydog.__version__":
            continue
        assert room_of(module) <= room_of(own), f"{own} imports {module}, from a lower room"


@pytest.mark.parametrize(
    "line",
    [
        "from skydog.commands import console",
        "from skydog import commands",
        "import skydog.commands.console as console",
        "import_module('skydog.commands.console')",
    ],
)
def test_an_arrow_that_runs_upwards_is_found_out(tmp_path, line):
    bad = tmp_path / "bad.py"
    bad.write_text(f"def later():\n    {line}\n")
    (module,) = imports(bad)
    assert room_of(module) > room_of("skydog.world.mission")


def test_a_relative_import_is_found_out(tmp_path):
    bad = tmp_path / "bad.py"
    bad.write_text("from ..commands import console\n")
    with pytest.raises(AssertionError, match="relatively, in line 1"):
        list(imports(bad))


WRITTEN = [
    file
    for folder in ("src", "tests", "examples", "benchmarks")
    for file in sorted((ROOT / folder).rglob("*"))
    if file.suffix in (".py", ".html", ".js", ".css")
]


@pytest.mark.parametrize("file", WRITTEN, ids=lambda file: str(file.relative_to(ROOT)))
def test_no_file_is_longer_than_400_lines(file):
    assert len(file.read_text().splitlines()) <= 400
