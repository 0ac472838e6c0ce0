"""Which file a sheepdog's name means. Free to import, so that a mistyped name costs no time."""

from pathlib import Path

from skydog import files
from skydog.errors import Refusal

FILE = "sheepdog.safetensors"
ZOO = Path(__file__).parent / "zoo"
# See `skydog.shepherds.rules`.
RULES = ("strombom", "strombom-arrive", "elfiqi", "arc", "rearmost", "team", "lama", "ring")
TEAM = "team:"  # before a sheepdog's name: a team whose dogs fly with its skills


def check(name: str) -> None:
    """Raise `Refusal` for a shepherd that there is not."""
    if name not in RULES:
        find(Path(name.removeprefix(TEAM)))


def ships() -> list[str]:
    """The names of the sheepdogs in the zoo, which come with the package."""
    return sorted(path.stem for path in ZOO.glob("*.safetensors"))


def find(path: Path) -> Path:
    """The file of a sheepdog that is named by its name in the zoo, its file or its run folder.

    Raises `Refusal` if there is none.
    """
    if not files.exists(path) and path.parent == Path() and not path.suffix:
        if path.name.lower() in ships():
            return ZOO / f"{path.name.lower()}.safetensors"
        raise Refusal(
            f"no sheepdog is called {path}, and no file or folder; those that ship are "
            + ", ".join(ships())
        )
    if not files.exists(path):
        raise Refusal(f"cannot read {path}: there is no such file; check the path")
    if not files.is_folder(path):
        return path
    if files.exists(path / FILE):
        return path / FILE
    runs = sorted(run.parent.name for run in files.listed(path, f"*/{FILE}"))
    if runs:
        raise Refusal(f"{path} holds {len(runs)} sheepdogs; name one, such as {path / runs[0]}")
    raise Refusal(f"{path} holds no {FILE}; name a run folder of skydog herd or skydog train")
