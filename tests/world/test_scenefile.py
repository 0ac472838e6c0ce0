"""Scenes from files in TOML and GeoJSON: what they hold, and what is refused."""

import json
import math

import pytest

from skydog.errors import Refusal
from skydog.world import scenefile
from skydog.world.presets import preset
from skydog.world.scenes import Scene

pytestmark = pytest.mark.usefixtures("unchecked")

TOML = """
size = [12, 8]
start = [7, 0.5, 11.5, 7.5]
goal = [1, 6]
goal_radius = 1.5
dogs = "DOGS"
wall_radius = 0.1
walls = [[[6, 3], [6, 8]]]
discs = [[9, 5, 0.5]]
"""


WALLS = (((6.0, 3.0), (6.0, 8.0), 0.1), ((9.0, 5.0), (9.0, 5.0), 0.5))


def of(kind, coordinates, **known):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": known, "geometry": geometry}


def geojson(**changes):
    """The features of the scene in `TOML`, some of them changed, or left out as None."""
    box = [[0, 0], [12, 0], [12, 8], [0, 8], [0, 0]]
    start = [[7, 0.5], [11.5, 0.5], [11.5, 7.5], [7, 7.5], [7, 0.5]]
    features = {
        "arena": of("Polygon", [box], role="arena"),
        "start": of("Polygon", [start], role="start"),
        "goal": of("Point", [1, 6], role="goal", radius=1.5),
        "wall": of("LineString", [[6, 3], [6, 8]], radius=0.1),
        "disc": of("Point", [9, 5, 0], role="disc", radius=0.5),
    }
    features = {name: one for name, one in {**features, **changes}.items() if one is not None}
    return {"type": "FeatureCollection", "features": list(features.values())}


@pytest.mark.parametrize("dogs", ["above", "around"])
def test_both_formats_hold_the_same_scene(tmp_path, dogs):
    pytest.importorskip("shapely")
    toml, drawn = tmp_path / "a.toml", tmp_path / "a.geojson"
    toml.write_text(TOML.replace("DOGS", dogs))
    drawn.write_text(json.dumps({**geojson(), "dogs": dogs}))
    start = 7.0, 0.5, 11.5, 7.5
    scene = Scene((12.0, 8.0), WALLS, start, (1.0, 6.0), 1.5, dogs == "around")
    assert scenefile.read(toml) == scenefile.read(drawn) == scene
    world = preset("paper", scene=toml)
    assert world.arena.plain_sides == (12.0, 8.0)
    assert float(world.arena.goal_radius) == 1.5


def test_a_polygon_is_a_wall_all_around_and_many_lines_are_many(tmp_path):
    pytest.importorskip("shapely")
    polygon = [[[2, 2], [4, 2], [4, 4], [2, 2]], [[3, 2.5], [3.5, 2.5], [3.5, 3], [3, 2.5]]]
    lines = [[[6, 1], [7, 1]], [[8, 1], [9, 1], [9, 2]]]
    walls = geojson(wall=of("Polygon", polygon), disc=of("MultiLineString", lines))
    path = tmp_path / "b.json"
    path.write_text(json.dumps(walls))
    read = scenefile.read(path)
    assert len(read.walls) == 3 + 3 + 1 + 2
    assert {radius for *_, radius in read.walls} == {scenefile.WALL}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size = [12, 8]", "", "a scene says its size; add size = "),
        ("goal = [1, 6]", "", "a scene says its goal"),
        ("[12, 8]", "[12, 0]", "sides above 0 m, got 12 x 0"),
        ("[12, 8]", "[12, nan]", "size has 2 numbers"),
        ("[12, 8]", "[12]", "size has 2 numbers"),
        ("[12, 8]", "12", "size has 2 numbers"),
        ("[12, 8]", '["12", 8]', "size has 2 numbers"),
        ("[12, 8]", "[true, 8]", "size has 2 numbers"),
        ("[12, 8]", f"[{10**400}, 8]", "size has 2 numbers"),
        ("goal = [1, 6]", "goal = [1, 60]", "the goal lies in the arena, 12 x 8 m"),
        ("goal_radius = 1.5", "goal_radius = -1.5", "goal_radius is a length above 0"),
        ("goal_radius = 1.5", "goal_radius = inf", "goal_radius is a length above 0"),
        ("goal_radius = 1.5", "goal_radius = 9.5", "arena must be longer than 9.5 m"),
        ("wall_radius = 0.1", "wall_radius = 0", "wall_radius is a length above 0"),
        ("DOGS", "below", "'above' obstacles or 'around' them, got 'below'"),
        ("[7, 0.5, 11.5, 7.5]", "[7, 0.5, 6, 7.5]", "the sheep start in a box in the arena"),
        ("[7, 0.5, 11.5, 7.5]", "[7, 0.5, 13, 7.5]", "the sheep start in a box in the arena"),
        ("[[[6, 3], [6, 8]]]", "[[[6, 3]]]", "a wall is a line of two points or more"),
        ("[[[6, 3], [6, 8]]]", "[[6, 3], [6, 8]]", "walls has 2 numbers|walls is a list"),
        ("[[[6, 3], [6, 8]]]", "[[[6, 3], [6, 1e9]]]", "walls has 2 numbers in metres, to 100000"),
        ("[[9, 5, 0.5]]", "[[9, 5]]", "discs has 3 numbers"),
        ("[[9, 5, 0.5]]", "[[9, 5, 0]]", "discs is a length above 0"),
        ("[[9, 5, 0.5]]", "[[1, 6, 3]]", "the goal at 1,6 lies within an obstacle"),
        ("discs =", "disks =", "a scene has no 'disks'; choose from size, start"),
        ("size = [12, 8]", "size = ", "a.toml"),
        ("discs = [[9, 5, 0.5]]", f"discs = {[[9, 5, 0.1]] * 10_001}", "10,000 at most"),
    ],
    ids=lambda value: str(value)[:24],
)
def test_a_bad_scene_in_toml_is_refused_with_the_fix(tmp_path, old, new, said):
    path = tmp_path / "a.toml"
    path.write_text(TOML.replace("DOGS", "above").replace(old.replace("DOGS", "above"), new))
    with pytest.raises(Refusal, match=said):
        preset("paper", scene=path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (geojson(arena=None), "no feature has the role 'arena'"),
        (geojson(goal=None), "no feature has the role 'goal'"),
        (geojson(disc=of("Point", [9, 5])), "a disc has a property radius"),
        (geojson(disc=of("Point", [9, 5], radius="1")), "radius is a length above 0"),
        (geojson(disc=of("Point", [9, 5], radius=10**400)), "radius is a length above 0"),
        (geojson(disc=of("Point", [9, 5], role="tree")), "role is one of arena, start, goal"),
        (geojson(disc=of("Point", [9, 5], role=["wall"])), "role is one of arena, start, goal"),
        (geojson(disc=of("LineString", [])), "role is one of|geometry that is none"),
        (geojson(disc=of("MultiPoint", [[1, 1]], radius=1)), "a wall is a line or a polygon"),
        (geojson(disc=of("LineString", [[1, 1], [math.nan, 2]])), "further than|is none"),
        (geojson(disc=of("LineString", [[1, 1], [10**400, 2]])), "none|no GeoJSON"),
        (geojson(disc=of("Cloud", [[1, 1]])), "geometry that is none|no GeoJSON"),
        (geojson(arena=of("Polygon", [[[5, 0], [9, 0], [9, 9]]], role="arena")), "is none|0,0"),
        ({**geojson(), "dogs": 3}, "dogs fly 'above' obstacles or 'around' them, got 3"),
        ({"features": [{"geometry": None}]}, "geometry that is none|no GeoJSON"),
        ({"features": 3}, "is no GeoJSON of features"),
        ([], "is no GeoJSON of features"),
        ("[" * 100_000, "is no GeoJSON of features"),
        ("import os", "is no GeoJSON of features"),
    ],
    ids=lambda value: None,
)
def test_a_bad_scene_in_geojson_is_refused_with_the_fix(tmp_path, content, said):
    pytest.importorskip("shapely")
    path = tmp_path / "a.geojson"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(Refusal, match=said):
        preset("paper", scene=path)


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("#" * (scenefile.LARGEST + 1))
    with pytest.raises(Refusal, match=r"a\.toml"):
        scenefile.read(path)


def test_an_arena_cannot_be_asked_for_beside_a_file(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(TOML.replace("DOGS", "above"))
    with pytest.raises(Refusal, match="has an arena of its own; leave out --arena 20"):
        preset("paper", 20.0, scene=path)
