"""What the links look like."""

import warnings
from typing import Any

from ..errors import RobodynWarning
from ..model import Box, Cylinder, Mechanism, Mesh, Sphere, Visual
from . import meshes
from .encode import placement
from .skeleton import skeleton


def figure(mechanism: Mechanism) -> dict[str, Any]:
    """The page's record of the links' shapes; every mesh file stands in it once.

    Warns about each mesh that cannot be drawn. A robot without anything to draw is shown as a skeleton.
    """
    files = _MeshFiles()
    shapes = [[shape for visual in link.visuals if (shape := _shape(visual, link.name, files))] for link in mechanism.links]
    if not any(shapes):
        shapes = [
            [_shape(visual, link.name, files) for visual in own] for link, own in zip(mechanism.links, skeleton(mechanism), strict=True)
        ]
    return {"links": mechanism.link_names, "shapes": shapes, "meshes": files.parts}


class _MeshFiles:
    """Each mesh file read once, however many visuals show it."""

    def __init__(self) -> None:
        self.parts: list[list[dict[str, Any]]] = []
        self._found: dict[str, int | str] = {}

    def find(self, path: str | None) -> int | str:
        """Where the file's parts stand, or the reason why there are none."""
        if path is None:
            return "the file was not found"
        if path not in self._found:
            try:
                self.parts.append(meshes.read(path))
                self._found[path] = len(self.parts) - 1
            except Exception as error:  # trimesh's readers raise anything at all on a damaged file
                self._found[path] = f"{type(error).__name__}: {error}"
        return self._found[path]


def _shape(visual: Visual, link: str, files: _MeshFiles) -> dict[str, Any] | None:
    """One visual; None, and a warning, where its mesh cannot be drawn."""
    match visual.geometry:
        case Box(size=size):
            form = {"form": "box", "size": size}
        case Cylinder(radius=radius, length=length):
            form = {"form": "cylinder", "size": (radius, length)}
        case Sphere(radius=radius):
            form = {"form": "sphere", "size": (radius,)}
        case Mesh(filename=filename, path=path, scale=scale):
            found = files.find(path)
            if isinstance(found, str):
                warnings.warn(RobodynWarning(f"link {link!r}: the mesh {filename!r} is not drawn: {found}"), stacklevel=2)
                return None
            form = {"form": "mesh", "size": scale, "mesh": found}
    return {**form, "place": placement(visual.rotation, visual.translation).tolist(), "colour": visual.colour}
