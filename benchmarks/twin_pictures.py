"""A mission of the twin in pictures: a still, and a film as GIF.

    python benchmarks/twin_pictures.py docs

writes twin.png and twin.gif. The mission is the one of
`skydog twin h-ddpg-6x6 --profile ardrone2 --disturb lab --cases 1 --seed 2`.
"""

import sys
import tempfile
from pathlib import Path

import av
import jax
from PIL import Image, ImageColor

from skydog import files
from skydog.flight import profiles
from skydog.shepherds import store
from skydog.study import evaluate
from skydog.twin import Twin, film, starts
from skydog.view.colours import ROLES
from skydog.world.presets import preset
from skydog.world.trace import Trace

DOG, DRONE, SEED = "h-ddpg-6x6", "ardrone2", 2
TITLE = f"{DOG}, {DRONE}, lab"
STILL_AT = 7.0  # s of the mission
LONGEST = 9.0  # s of film, in place of its half minute: the mission is shown 3 times as fast
EVERY = 2  # of the film's frames one is kept
SIZE = 640, 360  # pixels
SHADES = 112  # of the frames; and the roles' own colours, of which few pixels are


def fly() -> Trace:
    world, rover = preset("paper-physical"), profiles.rover("kobuki")
    begin = starts.draw(world, 1, "spaced", profiles.uav(DRONE), rover, SEED)
    fly = Twin(DRONE, disturb="lab")
    return evaluate.one_case(fly(world, store.load(DOG), begin, 1000, jax.random.key(SEED)), 0)


def as_gif(movie: Path, out: Path) -> None:
    """Some frames of an MP4, smaller, in one palette."""
    with av.open(str(movie)) as opened:
        shots = [
            frame.to_image().resize(SIZE, Image.Resampling.LANCZOS)
            for number, frame in enumerate(opened.decode(video=0))
            if number % EVERY == 0
        ]
    sample = Image.new("RGB", (SIZE[0], SIZE[1] * len(shots[::8])))
    for number, shot in enumerate(shots[::8]):
        sample.paste(shot, (0, SIZE[1] * number))
    shades = sample.quantize(SHADES).getpalette() or []
    roles = [channel for colour in ROLES.values() for channel in ImageColor.getrgb(colour)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(shades[: 3 * SHADES] + roles)
    drawn = [shot.quantize(palette=palette, dither=Image.Dither.NONE) for shot in shots]
    lasts = 1000 * EVERY / film.RATE
    drawn[0].save(out, save_all=True, append_images=drawn[1:], duration=lasts, loop=0)


def main() -> None:
    out, mission = Path(sys.argv[1]), fly()
    files.write_bytes(out / "twin.png", film.still(mission, STILL_AT, DRONE, title=TITLE))
    film.LONGEST = LONGEST
    with tempfile.TemporaryDirectory() as folder:
        movie = Path(folder, "twin.mp4")
        film.save(movie, mission, DRONE, title=TITLE)
        as_gif(movie, out / "twin.gif")


if __name__ == "__main__":
    main()
