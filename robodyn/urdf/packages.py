"""Mesh file names → files. Nothing is opened here, and nothing is ever fetched."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import unquote


def find(filename: str, folder: Path | None, package_dirs: Iterable[Path] = ()) -> str | None:
    """The file that a robot file in `folder` means by `filename`; None where there is none.

    `package://PKG/rest` (or model://): in `package_dirs`, each of which may hold the package or be it, under whatever
    name; then beside and above the robot file; then where ROS_PACKAGE_PATH and AMENT_PREFIX_PATH point.
    `file://` and absolute names as they stand. Relative names: from the robot file's folder (without one, from the
    current folder), then from `package_dirs`.

    A hostile file can thereby name any file of this machine, so whoever opens the result reads it as a mesh and as
    nothing else. A package's `..` do not lead out of it; names of other hosts are refused.
    """
    name = filename.replace("\\", "/")
    scheme, separator, rest = name.partition("://")
    if not separator:
        candidates = _relative(name, folder, package_dirs)
    elif scheme in ("package", "model"):
        candidates = _packaged(*_split(rest), folder, package_dirs)
    else:
        candidates = _relative(unquote(rest.removeprefix("localhost")), folder, ()) if scheme == "file" else ()
    # os.path, unlike pathlib, answers False for names that the system refuses; // may reach over the network.
    return next((p for p in map(os.path.normpath, candidates) if not p.startswith("//") and os.path.isfile(p)), None)


def _split(name: str) -> tuple[str, str]:
    package, _, rest = name.partition("/")
    return package, os.path.normpath("/" + rest).lstrip("/")  # at the root, `..` leads nowhere


def _relative(name: str, folder: Path | None, package_dirs: Iterable[Path]) -> Iterator[str]:
    for base in [folder or Path.cwd(), *package_dirs]:
        yield os.path.join(base, name)


def _packaged(package: str, rest: str, folder: Path | None, package_dirs: Iterable[Path]) -> Iterator[str]:
    if package in ("", ".", ".."):
        return
    given = list(package_dirs)
    above = [folder, *folder.parents] if folder else []
    ros = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    ament = [Path(p) / "share" for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for base in [*given, *above, *ros, *ament]:
        yield os.path.join(base, package, rest)
        if base in given or base.name == package:
            yield os.path.join(base, rest)
