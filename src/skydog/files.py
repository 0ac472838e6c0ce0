"""Files that are never half written, and are read with bounds."""

import errno
import fcntl
import hashlib
import math
import os
import stat
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from skydog.errors import Refusal

LONGEST_NAME = 249  # bytes to which a dot and an ending can be added
LARGEST_FILE = 1 << 30  # bytes; a checkpoint of eight full memories fits


def status(path: Path) -> os.stat_result | None:
    """What stands at a path, links followed; None if nothing does.

    Raises `Refusal` for a path that cannot be: too long, with a NUL in it, in a folder that may
    not be read.
    """
    try:
        return os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as problem:
        raise Refusal(f"cannot read {path}: {_why(problem)}; check the path") from None


def exists(path: Path) -> bool:
    """Whether anything stands at a path. Raises `Refusal` as `status` does."""
    return status(path) is not None


def is_folder(path: Path) -> bool:
    """Whether a folder stands at a path. Raises `Refusal` as `status` does."""
    found = status(path)
    return found is not None and stat.S_ISDIR(found.st_mode)


def listed(path: Path, pattern: str) -> list[Path]:
    """What a folder holds by a pattern. Raises `Refusal` if it cannot be read."""
    try:
        os.scandir(path).close()  # `glob` finds nothing where it may not look
        return sorted(Path(path).glob(pattern))
    except OSError as problem:
        raise Refusal(f"cannot read {path}: {_why(problem)}; check the path") from None


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: a reader sees the old one or the new one.

    A link is followed, and a file that is replaced keeps its mode and its owner. Raises `Refusal`
    if the file cannot be written, or if something else than a file stands there.
    """
    target = Path(path)
    try:
        before = _replaceable(target)
        target = Path(os.path.realpath(target))
        folder(target.parent)
        partial, handle = _partial(target)
        try:
            with os.fdopen(handle, "wb") as file:
                os.ftruncate(handle, 0)
                file.write(content)
                file.flush()
                if before is not None:
                    with suppress(PermissionError):  # only root gives files away
                        os.fchown(handle, before.st_uid, before.st_gid)
                    os.fchmod(handle, before.st_mode & 0o777)  # nobody is trusted anew
                os.fsync(handle)
                os.replace(partial, target)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    except Refusal:
        raise
    except (OSError, ValueError) as problem:
        raise Refusal(f"cannot write {path}: {_why(problem)}; choose another file") from None


def write_text(path: Path, content: str) -> None:
    """`write_bytes` for text, in UTF-8."""
    # A path from the command line may hold bytes that are no UTF-8: they are written escaped.
    write_bytes(path, content.encode("utf-8", "backslashreplace"))


def may_write(path: Path) -> None:
    """Raise `Refusal` if a file cannot be written there: to be asked before long work."""
    _replaceable(Path(path))
    folder(Path(os.path.realpath(path)).parent)


def folder(path: Path) -> Path:
    """The folder, made if need be. Raises `Refusal` if it cannot be written."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as problem:
        raise Refusal(f"cannot write to {path}: {_why(problem)}; choose another folder") from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise Refusal(f"cannot write to {path}: permission denied; choose another folder")
    return path


@contextmanager
def claimed(path: Path, patience: float = 0.0) -> Iterator[Path]:
    """A run folder, made if need be, that belongs to this run alone as long as the context lasts.

    A run that is killed leaves no claim behind. Raises `Refusal` if another run has it for longer
    than `patience` seconds, or if it cannot be written.
    """
    handle = os.open(folder(path), os.O_RDONLY)
    until = time.monotonic() + patience
    try:
        while not _locked(handle):
            if time.monotonic() >= until:
                raise Refusal(
                    f"another run is at work in {path}; wait for it, or choose another --out"
                )
            time.sleep(0.05)
        yield Path(path)
    finally:
        os.close(handle)


def _locked(folder: int) -> bool:
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as problem:  # some file systems know no locks
        if problem.errno not in (errno.ENOTSUP, errno.ENOLCK, errno.ENOSYS, errno.EBADF):
            raise
    return True


def read_bytes(path: Path, kind: str, largest: int = LARGEST_FILE) -> bytes:
    """What a file holds, of at most `largest` bytes; `kind` says what it ought to be.

    Raises `Refusal` for a file that is missing, too large, or no regular one.
    """
    path = Path(path)
    try:
        found = os.stat(path)
        if stat.S_ISDIR(found.st_mode):
            raise Refusal(f"{path} is a folder; name a file in it")
        if not stat.S_ISREG(found.st_mode):
            raise Refusal(f"{path} is no regular file; name another")
        if found.st_size > largest:
            raise Refusal(f"{path} has {found.st_size:,} bytes, more than any {kind} ({largest:,})")
        with path.open("rb") as file:
            return file.read(largest)
    except Refusal:
        raise
    except (OSError, ValueError) as problem:
        raise Refusal(f"cannot read {path}: {_why(problem)}; check the path") from None


def read_toml(path: Path, kind: str, largest: int) -> dict[str, Any]:
    """The table of a TOML file. Raises `Refusal` as `read_bytes` does, and for what is no TOML."""
    try:
        return tomllib.loads(read_bytes(path, kind, largest).decode())
    except Refusal:
        raise
    except (ValueError, RecursionError) as problem:
        raise Refusal(f"{path} is not valid TOML: {problem!s:.120}") from None


def plain(value: Any) -> Any:
    """Nested values as JSON returns them: lists for tuples, text for keys.

    A number that is not finite becomes None, since JSON has none.
    """
    if isinstance(value, dict):
        return {str(name): plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _replaceable(path: Path) -> os.stat_result | None:
    """What stands where a file is to be written, None if nothing. Raises `Refusal` if no file."""
    found = status(path)
    if found is None:
        return None
    if stat.S_ISDIR(found.st_mode):
        raise Refusal(f"{path} is a folder; name a file in it")
    if not stat.S_ISREG(found.st_mode):
        raise Refusal(f"{path} is {_called(found.st_mode)}, no file to write to; name another")
    if not os.access(path, os.W_OK):
        raise Refusal(f"cannot write {path}: permission denied; choose another file")
    return found


def _called(mode: int) -> str:
    kinds = {
        stat.S_ISCHR: "a device",
        stat.S_ISBLK: "a device",
        stat.S_ISFIFO: "a pipe",
        stat.S_ISSOCK: "a socket",
    }
    return next((name for is_one, name in kinds.items() if is_one(mode)), "something else")


def _partial(target: Path) -> tuple[Path, int]:
    """A file beside the target to write to, and its handle, which nobody else writes to.

    It always has the same name: what a kill leaves behind, the next write takes up.
    """
    whole = len(os.fsencode(target.name)) <= LONGEST_NAME
    name = target.name if whole else hashlib.sha256(os.fsencode(target.name)).hexdigest()
    partial = target.with_name(f".{name}.part")
    flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    while True:
        handle = os.open(partial, flags, 0o666)
        try:
            with suppress(OSError):  # some file systems know no locks
                fcntl.flock(handle, fcntl.LOCK_EX)
            found = os.fstat(handle)
            if _same(partial, found):
                if found.st_uid != os.geteuid() or found.st_nlink > 1:  # somebody's trap, perhaps
                    raise OSError(errno.EEXIST, f"{partial.name} is in the way")
                return partial, handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # another writer was quicker, and has moved it to its place


def _same(path: Path, found: os.stat_result) -> bool:
    with suppress(FileNotFoundError):
        return os.path.samestat(os.lstat(path), found)
    return False


def _why(problem: Exception) -> str:
    return getattr(problem, "strerror", None) or str(problem)
