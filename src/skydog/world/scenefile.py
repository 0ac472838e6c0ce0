"""A scene from a file: TOML, or GeoJSON, which maps and drawing programs write."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

from skydog import files
from skydog.errors import Refusal, short
from skydog.world.obstacles import MOST_OBSTACLES
from skydog.world.scenes import Point, Scene, Wall

LARGEST = 1 << 22  # bytes of a file
LONGEST = 1e5  # metres of any number
WALL = 0.1  # metres: the radius of a wall of which the file does not say it

KEYS = ("size", "start", "goal", "goal_radius", "dogs", "wall_radius", "walls", "discs")
DOGS = ("above", "around")
ROLES = ("arena", "start", "goal", "wall", "disc")


def read(path: Path) -> Scene:
    """The scene in a file, by its suffix: `.toml`, or `.geojson` or `.json`. Metres.

    TOML: `size = [x, y]`, `start = [least x, least y, greatest x, greatest y]`, `goal = [x, y]`,
    and where wanted `goal_radius`, `wall_radius`, `dogs = "above"` or `"around"`,
    `walls = [[[x, y], [x, y], ...], ...]` (lines) and `discs = [[x, y, radius], ...]`.

    GeoJSON: features with a property `role`. `arena` and `start` are polygons, of which the box
    around them counts; `goal` is a point, with a property `radius` where wanted; `wall` is a line
    or a polygon, whose rim is the wall; `disc` is a point with a `radius`. A feature without a
    role is a wall. Coordinates are metres in the world frame, not degrees. `dogs` may stand beside
    `features`.

    Raises `Refusal` for anything else.
    """
    path = Path(path)
    if path.suffix == ".toml":
        return _checked(path, _from_toml(path, files.read_toml(path, "scene", LARGEST)))
    if path.suffix in (".geojson", ".json"):
        return _checked(path, _from_geojson(path, files.read_bytes(path, "scene", LARGEST)))
    raise Refusal(f"a scene's file ends in .toml or .geojson, got {short(path.name)}; rename it")


def _from_toml(path: Path, table: dict[str, Any]) -> Scene:
    unknown = sorted(set(table) - set(KEYS))
    if unknown:
        raise Refusal(f"{path}: a scene has no {short(unknown[0])}; choose from {', '.join(KEYS)}")
    missing = [name for name in ("size", "start", "goal") if name not in table]
    if missing:
        raise Refusal(f"{path}: a scene says its {missing[0]}; add {missing[0]} = [...] in metres")
    thick = _length(path, "wall_radius", table.get("wall_radius", WALL))
    walls: list[Wall] = []
    for line in _list(path, "walls", table.get("walls", [])):
        points = [_point(path, "walls", point) for point in _list(path, "walls", line)]
        walls += _line(path, points, thick)
    for disc in _list(path, "discs", table.get("discs", [])):
        x, y, radius = _numbers(path, "discs", disc, 3)
        walls.append(((x, y), (x, y), _length(path, "discs", radius)))
    left, low, right, high = _numbers(path, "start", table["start"], 4)
    radius = table.get("goal_radius")
    return Scene(
        sides=_point(path, "size", table["size"]),
        walls=tuple(walls),
        start=(left, low, right, high),
        goal=_point(path, "goal", table["goal"]),
        goal_radius=None if radius is None else _length(path, "goal_radius", radius),
        tall=_tall(path, table),
    )


def _from_geojson(path: Path, content: bytes) -> Scene:
    try:
        from shapely.geometry import shape
    except ImportError:
        raise Refusal(
            "a scene in GeoJSON needs shapely; run: pip install 'skydog[scenes]'"
        ) from None
    try:
        found = json.loads(content)
        listed = found["features"]
        features = [
            (dict(each.get("properties") or {}), shape(each["geometry"])) for each in listed
        ]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as problem:
        raise Refusal(f"{path} is no GeoJSON of features: {problem!s:.120}") from None
    except Exception as problem:  # what shapely and its GEOS raise has no name in common
        raise Refusal(f"{path} holds a geometry that is none: {problem!s:.120}") from None
    boxes: dict[str, tuple[float, float, float, float]] = {}
    goal: tuple[Point, float | None] | None = None
    walls: list[Wall] = []
    for known, geometry in features:
        role = known.get("role", "wall")
        if role not in ROLES or geometry.is_empty:
            raise Refusal(
                f"{path}: a feature's role is one of {', '.join(ROLES)}, got {short(role)}"
            )
        radius = known.get("radius")
        radius = None if radius is None else _length(path, "radius", radius)
        if role in ("arena", "start"):
            boxes[role] = geometry.bounds
        elif role == "goal":
            goal = (geometry.centroid.x, geometry.centroid.y), radius
        elif geometry.geom_type == "Point":
            if radius is None:
                raise Refusal(f"{path}: a disc has a property radius in metres; add it")
            x, y = geometry.centroid.x, geometry.centroid.y
            walls.append(((x, y), (x, y), radius))
        else:
            for line in _lines(path, geometry):
                walls += _line(path, line, WALL if radius is None else radius)
    if goal is None or set(boxes) != {"arena", "start"}:
        lacks = [role for role in ROLES[:2] if role not in boxes] or ["goal"]
        raise Refusal(f"{path}: no feature has the role {lacks[0]!r}; add a property role to one")
    left, low, right, high = boxes["arena"]
    if max(abs(left), abs(low)) > 1e-6:
        raise Refusal(f"{path}: the arena begins at 0,0, got {left:g},{low:g}; move the drawing")
    return Scene((right, high), tuple(walls), boxes["start"], *goal, tall=_tall(path, found))


def _tall(path: Path, found: dict[str, Any]) -> bool:
    dogs = found.get("dogs", DOGS[0])
    if dogs not in DOGS:
        raise Refusal(f"{path}: dogs fly 'above' obstacles or 'around' them, got {short(dogs)}")
    return dogs == "around"


def _lines(path: Path, geometry: Any) -> list[list[Point]]:
    if hasattr(geometry, "geoms"):
        return [line for part in geometry.geoms for line in _lines(path, part)]
    if geometry.geom_type == "Polygon":
        return [list(ring.coords) for ring in (geometry.exterior, *geometry.interiors)]
    if geometry.geom_type in ("LineString", "LinearRing"):
        return [[(x, y) for x, y, *_ in geometry.coords]]
    raise Refusal(f"{path}: a wall is a line or a polygon, got a {geometry.geom_type}")


def _line(path: Path, points: list[Point], radius: float) -> list[Wall]:
    if len(points) < 2:
        raise Refusal(f"{path}: a wall is a line of two points or more, got {short(points)}")
    pairs = pairwise(points)
    return [((x, y), (a, b), radius) for (x, y, *_), (a, b, *_) in pairs]


def _checked(path: Path, scene: Scene) -> Scene:
    """The scene, if all of it is in bounds and its start in its arena."""
    wide, high = scene.sides
    left, low, right, top = scene.start
    if not (wide > 0.0 and high > 0.0):
        raise Refusal(f"{path}: the arena has sides above 0 m, got {wide:g} x {high:g}")
    if not (0.0 <= left < right <= wide and 0.0 <= low < top <= high):
        raise Refusal(
            f"{path}: the sheep start in a box in the arena of {wide:g} x {high:g} m, "
            f"got {left:g}, {low:g} to {right:g}, {top:g}"
        )
    if len(scene.walls) > MOST_OBSTACLES:
        raise Refusal(f"{path} has {len(scene.walls):,} obstacles; {MOST_OBSTACLES:,} at most")
    numbers = [at for first, last, _ in scene.walls for point in (first, last) for at in point]
    if not all(abs(number) <= LONGEST for number in (*numbers, *scene.goal)):
        raise Refusal(f"{path} holds a place further than {LONGEST:g} m; give metres")
    return scene


def _list(path: Path, name: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise Refusal(f"{path}: {name} is a list, got {short(value)}")
    return value


def _numbers(path: Path, name: str, value: Any, count: int) -> list[float]:
    plain = isinstance(value, list) and len(value) == count
    # Compared, not converted: a whole number may be too large for a float.
    if not plain or not all(type(one) in (int, float) and abs(one) <= LONGEST for one in value):
        raise Refusal(
            f"{path}: {name} has {count} numbers in metres, to {LONGEST:g}, got {short(value)}"
        )
    return [float(one) for one in value]


def _point(path: Path, name: str, value: Any) -> Point:
    x, y = _numbers(path, name, value, 2)
    return x, y


def _length(path: Path, name: str, value: Any) -> float:
    if type(value) not in (int, float) or not 0.0 < value <= LONGEST:
        raise Refusal(f"{path}: {name} is a length above 0 m, got {short(value)}")
    return float(value)
