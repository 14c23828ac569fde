"""Writing files whole or not at all."""

import os
import tempfile
from pathlib import Path

from .errors import FileError


def atomic_write(path: str | os.PathLike[str], data: str | bytes, *, mode: int = 0o666) -> None:
    """Write `data` (text as UTF-8) to `path`: readers see the old file or the whole new one, whatever happens in between.

    Raises FileError where the folder is missing or not writable, or the disk is full; the old file then still stands.
    """
    path = Path(path)
    data = data.encode() if isinstance(data, str) else data
    target = path.resolve()  # a link stays a link: what it points to is replaced
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, mode & ~umask)
        os.replace(temporary, target)
    except OSError as error:
        raise FileError(f"cannot write {str(path)!r}: {error.strerror or error}. Choose a folder that exists and has room") from error
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)
