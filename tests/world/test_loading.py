import sys

import pytest

from skydog import references
from skydog.errors import Refusal
from skydog.world import loading, presets
from skydog.world.params import World

FILE = '''
from dataclasses import replace

import jax.numpy as jnp

import skydog
from skydog.world.presets import paper

import beside_it

fixed = paper(arena=5.0)


def shy(arena: float = 6.0, sheep: int = 3):
    """Sheep that see far."""
    world = skydog.preset("paper", arena, sheep)
    return replace(world, flock=replace(world.flock, sensing=beside_it.SIGHT))


def broken(arena=4.0, sheep=3):
    return paper(arena, "three")


def flock_of_nine(arena=4.0, sheep=9):
    return paper(arena, sheep)


each = replace(fixed, sheep=replace(fixed.sheep, speed=jnp.full(7, 0.5)))


def needy(arena, sheep, goal):
    return fixed


def nothing(arena=1.0, sheep=3):
    return 42


number = 7
'''


@pytest.fixture
def file(tmp_path):
    (tmp_path / "beside_it.py").write_text("SIGHT = 3.5\n")
    path = tmp_path / "flocks.py"
    path.write_text(FILE)
    yield path
    references.run.cache_clear()
    sys.modules.pop("beside_it", None)
    sys.path[:] = [entry for entry in sys.path if entry != str(tmp_path)]


def test_a_function_of_arena_and_sheep_makes_worlds_as_a_preset_does(file):
    maker = loading.maker(f"{file}:shy")
    assert presets.make(maker).arena.size == 6.0
    world = presets.make(maker, 9.0, 12)
    assert isinstance(world, World)
    assert (world.arena.size, world.flock.sensing) == (9.0, 3.5)
    assert (maker.__doc__ or "").startswith("Sheep that see far")
    # A second look finds the same classes: what was compiled serves it.
    assert type(presets.make(loading.maker(f"{file}:shy")).flock) is type(world.flock)


def test_a_world_is_flown_as_it_is_or_in_an_arena_of_another_side(file):
    maker = loading.maker(f"{file}:fixed")
    assert presets.make(maker).arena.size == 5.0
    assert presets.make(maker, 7.0).arena.size == 7.0
    with pytest.raises(Refusal, match="--arena 4"):
        presets.make(maker, 1.0)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("wolves", "no world called 'wolves'.*fixed.*shy"),
        ("number", "no world called 'number'"),
        ("nothing", "returned 42"),
        ("needy", "arena=METRES and sheep=NUMBER.*goal"),
    ],
)
def test_a_name_that_is_no_world_is_refused(file, name, said):
    with pytest.raises(Refusal, match=said):
        presets.make(loading.maker(f"{file}:{name}"), 4.0)


@pytest.mark.parametrize(
    "reference", ["", "flocks", "flocks.py", ":fixed", "flocks.txt:fixed", "flocks.py:a b", "a:b:c"]
)
def test_what_names_no_file_and_no_name_is_refused_with_the_form(reference):
    with pytest.raises(Refusal, match=r"FILE\.py:NAME"):
        loading.maker(reference)


def test_a_file_that_is_missing_or_fails_is_refused_with_the_line(tmp_path):
    with pytest.raises(Refusal, match="no file"):
        loading.maker(f"{tmp_path}/none.py:world")
    broken = tmp_path / "broken.py"
    broken.write_text("import skydog\n\nworld = 1 / 0\n")
    with pytest.raises(Refusal, match="line 3: ZeroDivisionError"):
        loading.maker(f"{broken}:world")
    broken.write_text("def (:\n")
    with pytest.raises(Refusal, match="SyntaxError"):
        loading.maker(f"{broken}:world")


def test_what_fails_inside_a_function_is_refused_with_its_line(file):
    with pytest.raises(Refusal, match=r"broken in .* failed in line \d+: Type"):
        presets.make(loading.maker(f"{file}:broken"), 4.0)
    leaves = file.with_name("leaves.py")
    leaves.write_text("import sys\nsys.exit()\n")
    with pytest.raises(Refusal, match="line 2: SystemExit"):
        loading.maker(f"{leaves}:world")


@pytest.mark.parametrize(
    ("name", "sheep"), [("shy", 3), ("fixed", 3), ("flock_of_nine", 9), ("each", 7)]
)
def test_a_world_has_as_many_sheep_as_it_says(file, name, sheep):
    assert loading.sheep_of(loading.maker(f"{file}:{name}")) == sheep


def test_a_world_is_called_as_its_file_and_its_name(file):
    assert loading.title(f"{file}:shy") == "flocks-shy"
    file.write_text("world = 1\n")
    assert loading.title(f"{file}:world") == "flocks"


def test_a_changed_file_has_another_digest(file):
    before = loading.digest(f"{file}:shy")
    assert loading.digest(f"{file}:fixed") == before
    file.write_text(FILE + "\n")
    assert loading.digest(f"{file}:shy") != before
