"""One HTML file: meshcat's bundle, the robot, its motion and the controls, with no address in it that could be fetched."""

import json
import os
import re
import warnings
from base64 import b64encode
from hashlib import sha256
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..arithmetic import Array
from ..errors import MissingPackageError, RobodynWarning
from ..model import Mechanism
from ..system.files import atomic_write
from .figure import figure
from .motion import motion

SCRIPTS = ("shapes.js", "motion.js", "stage.js", "player.js")  # one module; each uses what stands before it
HEAVY = 50e6  # [bytes]: beyond this, browsers get slow and mail servers refuse


def write_html(path: str | os.PathLike[str], mechanism: Mechanism, *, times: Array, poses: Array, title: str | None = None) -> None:
    """Write the motion as one self-contained HTML file, whole or not at all.

    times (T,) [s]; poses (T, nlinks, 4, 4): world poses [m] of all links, in the order of `mechanism.link_names`.
    One instant gives a still picture. The same input gives the same bytes.
    Raises InputError for arrays that do not fit, MissingPackageError without meshcat; warns about meshes that cannot be drawn.
    """
    data = {**figure(mechanism), **motion(times, poses, len(mechanism.links))}
    page = assemble(title or mechanism.name, data).encode("utf-8", "replace")  # a title from a file name may hold anything
    if len(page) > HEAVY:
        hint = "give fewer frames per second" if 2 * len(data["poses"]) > len(page) else "give the robot lighter meshes"
        warnings.warn(
            RobodynWarning(f"{os.fspath(path)}: the page has {len(page) / 1e6:.0f} MB and will open slowly; {hint}"), stacklevel=2
        )
    atomic_write(path, page)


def assemble(title: str, data: dict[str, Any]) -> str:
    """The page's text. Its policy lets exactly these two scripts run, and nothing be fetched."""
    own = files("robodyn.view")
    bundle, notices = _meshcat()
    viewer, script = _inline(bundle), _inline("\n".join((own / name).read_text("utf-8") for name in SCRIPTS))
    parts = {
        "title": escape(title),
        "scripts": " ".join(_digest(text) for text in (viewer, script)),
        "style": (own / "page.css").read_text("utf-8"),
        "notices": _inline(notices),
        "viewer": viewer,
        "data": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "script": script,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], (own / "page.html").read_text("utf-8"))


def _meshcat() -> tuple[str, str]:
    """meshcat's browser bundle and the licence texts that belong to it. The package itself is not imported."""
    spec = find_spec("meshcat")
    if spec is None or not spec.submodule_search_locations:
        raise MissingPackageError("the page needs the browser bundle of the package meshcat: pip install meshcat")
    viewer = Path(spec.submodule_search_locations[0]) / "viewer"
    bundle = viewer / "dist" / "main.min.js"
    if not bundle.is_file():
        raise MissingPackageError(f"meshcat is installed without its browser bundle {bundle}: pip install --force-reinstall meshcat")
    licences = [viewer / "LICENSE", *sorted(bundle.parent.glob("main.min.js.*LICENSE*"))]
    return bundle.read_text("utf-8"), "\n\n".join(file.read_text("utf-8") for file in licences if file.is_file())


def _inline(script: str) -> str:
    """The script with nothing in it that would end, or nest, the <script> element around it."""
    return re.sub(r"<(?=/script|!--)", r"\\x3c", script, flags=re.IGNORECASE)


def _digest(script: str) -> str:
    return f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'"
