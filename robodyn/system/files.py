"""Writing files whole or not at all."""

import contextlib
import os
import stat
import tempfile
from pathlib import Path

from ..errors import FileError

UNFINISHED = ".robodyn.", ".part"  # how the names of files begin and end while they are written


def atomic_write(path: str | os.PathLike[str], data: str | bytes, *, mode: int = 0o666) -> None:
    """Write `data` (text as UTF-8) to `path`: readers see the old file or the whole new one, whatever happens in between.

    Raises FileError where the folder is missing or not writable, the disk is full, or `path` is no regular file (a pipe, a device);
    the old file then still stands.
    """
    target = writable(path)
    data = data.encode() if isinstance(data, str) else data
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=UNFINISHED[0], suffix=UNFINISHED[1])
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, _mode(target, mode))
        os.replace(temporary, target)
    except OSError as error:
        raise FileError(f"cannot write {str(path)!r}: {error.strerror or error}. Choose a folder that exists and has room") from error
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):  # gone where it became the target
                os.unlink(temporary)


def writable(path: str | os.PathLike[str]) -> Path:
    """The file that `path` means, links followed; FileError where no file can be there. Ask before a long computation."""
    try:
        target = Path(path).resolve()  # a link stays a link: what it points to is replaced
        if not os.fspath(path) or target.is_dir():
            raise FileError(f"cannot write {str(path)!r}: it is a folder, not a file")
        if not target.parent.is_dir():
            raise FileError(f"cannot write {str(path)!r}: there is no folder {str(target.parent)!r}")
        with contextlib.suppress(FileNotFoundError):
            if not stat.S_ISREG(target.stat().st_mode):
                raise FileError(f"cannot write {str(path)!r}: it is no regular file")
    except (OSError, ValueError) as error:
        raise FileError(f"cannot write {str(path)!r}: {error}") from error
    return target


def make_folder(path: str | os.PathLike[str]) -> Path:
    """The folder, made where it is not there; FileError where it cannot be."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise FileError(f"cannot make the folder {str(path)!r}: {getattr(error, 'strerror', None) or error}") from error
    return Path(path)


def _mode(target: Path, mode: int) -> int:
    """The permissions of the file that is replaced, or what the umask leaves of `mode`."""
    with contextlib.suppress(OSError):
        return stat.S_IMODE(target.stat().st_mode)
    umask = os.umask(0)
    os.umask(umask)
    return mode & ~umask
