"""Machine code that was compiled before, and what else was found out at some cost, in the user's cache directory.

An entry is found by a hash of everything that shapes it; of code: the IR, LLVM's version, the CPU and its features, the options. It is
loaded only from a folder that is the user's own, and only if its content is whole; everything else is compiled, or found, anew.
"""

import contextlib
import hashlib
import os
import stat
import time
from pathlib import Path

from .files import UNFINISHED, atomic_write

VARIABLE = "ROBODYN_CACHE"  # "off", or another folder
LIMIT = 256 * 2**20  # bytes; the entries used longest ago go first
STALE = 600.0  # [s]: what was begun longer ago and has no name yet was interrupted; another process writes for far less than that
_MAGIC = b"robodyn object code 1\n"


def folder() -> Path | None:
    """Where entries live; None where the cache is off or cannot be trusted."""
    setting = os.environ.get(VARIABLE, "")
    if setting.lower() in ("off", "0", "no", "false"):
        return None
    if setting:
        path = Path(setting).expanduser()
    else:
        from platformdirs import user_cache_path

        path = user_cache_path("robodyn", appauthor=False) / "kernels"
    try:
        path.mkdir(parents=True, exist_ok=True, mode=0o700)
        status = path.stat()
    except OSError:
        return None
    return path if _is_mine(status) else None


def key(*parts: str) -> str:
    """The name of an entry."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(f"{len(part)}\n".encode() + part.encode())
    return digest.hexdigest()


def get(name: str) -> bytes | None:
    """The entry's content; None where there is none, or it is damaged or foreign."""
    if (path := folder()) is None:
        return None
    if not _is_plain(path / name):
        return None
    try:
        data = (path / name).read_bytes()
    except OSError:
        return None
    head, code = data[: len(_MAGIC) + 64], data[len(_MAGIC) + 64 :]
    if head != _head(name, code):
        return None
    with contextlib.suppress(OSError):
        os.utime(path / name)  # used now
    return code


def put(name: str, code: bytes) -> None:
    """Keep an entry; a cache that cannot be written is none."""
    from ..errors import FileError

    if (path := folder()) is None:
        return
    with contextlib.suppress(FileError, OSError):
        if not _is_plain(path / name):  # what is foreign goes, or the new entry would be as open as that
            (path / name).unlink(missing_ok=True)
        atomic_write(path / name, _head(name, code) + code, mode=0o600)
        _shrink(path)


def clear() -> tuple[int, int]:
    """Remove every entry, and what interrupted writes have left; returns the number of entries and the bytes of all."""
    path = folder()
    entries = [_remove(file) for file in _entries(path)]
    return sum(n > 0 for n in entries), sum(entries) + sum(_remove(file) for file in _unfinished(path, STALE))


def usage() -> tuple[int, int]:
    """Number of entries, and the bytes of them and of writes that are not finished."""
    entries, size = _entries(folder()), 0
    for file in entries + _unfinished(folder()):
        with contextlib.suppress(OSError):  # another process may have removed it
            size += file.stat().st_size
    return len(entries), size


def _head(name: str, code: bytes) -> bytes:
    return _MAGIC + hashlib.sha256(name.encode() + code).hexdigest().encode()


def _entries(path: Path | None) -> list[Path]:
    return [file for file in path.iterdir() if len(file.name) == 64 and _is_ours(file)] if path is not None else []


def _is_ours(file: Path) -> bool:
    """Whether a file begins as entries do: the folder may be one that the user keeps other things in."""
    if not _is_plain(file):
        return False
    try:
        with file.open("rb") as stream:
            return stream.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def _is_mine(status: os.stat_result) -> bool:
    """Whether a folder or file is the user's own. Loading an entry runs it: nobody else may be able to put one there."""
    return not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & 0o022)


def _is_plain(file: Path) -> bool:
    """Whether it is a file of the user's itself: no link, and no pipe, whose end a reader would wait for."""
    try:
        status = file.lstat()
    except OSError:
        return False
    return stat.S_ISREG(status.st_mode) and _is_mine(status)


def _unfinished(path: Path | None, age: float = -float("inf")) -> list[Path]:
    """Files of writes that began at least `age` seconds ago and did not end."""
    found = []
    for file in path.iterdir() if path is not None else ():
        if file.name.startswith(UNFINISHED[0]) and file.name.endswith(UNFINISHED[1]):
            with contextlib.suppress(OSError):  # another process may have finished it
                if time.time() - file.stat().st_mtime >= age:
                    found.append(file)
    return found


def _shrink(path: Path) -> None:
    for file in _unfinished(path, STALE):
        _remove(file)
    files = []
    for file in _entries(path):
        with contextlib.suppress(OSError):  # another process may have removed it
            files.append((file.stat().st_mtime, file.stat().st_size, file))
    total = sum(size for _, size, _ in files)
    for _, size, file in sorted(files)[:-1]:
        if total <= LIMIT:
            return
        _remove(file)
        total -= size


def _remove(file: Path) -> int:
    try:
        size = file.stat().st_size
        file.unlink()
    except OSError:
        return 0
    return size
