"""What the links look like."""

import warnings
from typing import Any

from ..errors import RobodynWarning
from ..model import Box, Cylinder, Geometry, Mechanism, Mesh, Sphere, Visual
from . import meshes
from .encode import placement
from .skeleton import skeleton


def figure(mechanism: Mechanism) -> dict[str, Any]:
    """The page's record of the links' shapes; every mesh file stands in it once.

    Warns about each mesh that cannot be drawn. A robot without anything to draw is shown as a skeleton.
    """
    files = _Files()
    shapes = [[shape for visual in link.visuals if (shape := _shape(visual, link.name, files))] for link in mechanism.links]
    if not any(shapes):
        shapes = [[_shape(visual, "", files) for visual in visuals] for visuals in skeleton(mechanism)]
    return {"links": mechanism.link_names, "shapes": shapes, "meshes": files.parts}


class _Files:
    """Mesh files read so far: each one once, whether it could be read or not."""

    def __init__(self) -> None:
        self.parts: list[list[dict[str, Any]]] = []
        self._found: dict[str, int | Exception] = {}

    def number(self, path: str) -> int:
        """Where the file's parts stand; raises what reading it raised."""
        if path not in self._found:
            try:
                self.parts.append(meshes.read(path))
                self._found[path] = len(self.parts) - 1
            except Exception as error:  # trimesh's readers raise anything at all on a damaged file
                self._found[path] = error
        found = self._found[path]
        if isinstance(found, Exception):
            raise found
        return found


def _shape(visual: Visual, link: str, files: _Files) -> dict[str, Any] | None:
    """One visual; None, and a warning, where its mesh cannot be drawn."""
    try:
        form = _form(visual.geometry, files)
    except Exception as error:
        filename = getattr(visual.geometry, "filename", "")
        reason = str(error) or type(error).__name__
        warnings.warn(RobodynWarning(f"link {link!r}: the mesh {filename!r} is not drawn: {reason}"), stacklevel=2)
        return None
    return {**form, "place": placement(visual.rotation, visual.translation).tolist(), "colour": visual.colour}


def _form(geometry: Geometry, files: _Files) -> dict[str, Any]:
    match geometry:
        case Box(size):
            return {"form": "box", "size": size}
        case Cylinder(radius, length):
            return {"form": "cylinder", "size": (radius, length)}
        case Sphere(radius):
            return {"form": "sphere", "size": (radius,)}
        case Mesh(_, None, _):
            raise FileNotFoundError("the file was not found")
        case Mesh(_, path, scale):
            return {"form": "mesh", "size": scale, "mesh": files.number(path)}
