"""Mesh files, read by trimesh, as triangles that a page can carry."""

from typing import Any

import numpy as np

from ..arithmetic import Array
from .encode import base64


def read(path: str) -> list[dict[str, Any]]:
    """The parts of a mesh file [m], each with `vertices`, `triangles` and the file's own colours.

    As in RViz and Gazebo, a COLLADA file's <unit> counts and its <up_axis> does not.
    Raises whatever the file makes trimesh raise, and ValueError where there is nothing to draw.
    """
    import trimesh

    scene = trimesh.load_scene(path, process=False)
    parts = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            metres = trimesh.units.unit_conversion(mesh.units, "meters") if mesh.units else 1.0
            points = metres * trimesh.transform_points(mesh.vertices, transform)
            parts.append(_part(points, np.asarray(mesh.faces), _face_colours(mesh)))
    if not parts:
        raise ValueError("it has no triangles")
    return parts


def _part(points: Array, faces: Array, colours: Array | None) -> dict[str, Any]:
    """Triangles over distinct vertices, those without area left out."""
    used = points[faces.ravel()].astype("<f4")
    if not np.isfinite(used).all():
        raise ValueError("it has coordinates that are not finite")
    vertices, triangles = np.unique(used, axis=0, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    a, b, c = triangles.T
    whole = (a != b) & (b != c) & (c != a)

    return {
        "vertices": base64(vertices, "<f4"),
        "triangles": base64(triangles[whole], "<u4"),
        **({} if colours is None else _painted(colours[whole])),
    }


def _painted(colours: Array) -> dict[str, Any]:
    """One `colour` for the part where its faces agree, their `colours` where not."""
    if (colours == colours[:1]).all():
        return {"colour": (colours[0] / 255).tolist() if len(colours) else None}
    return {"colours": base64(colours[:, :3], "u1")}


def _face_colours(mesh: Any) -> Array | None:
    """Red, green, blue, alpha (faces, 4) in 0…255, from faces, vertices, material or texture; None where the file has none."""
    visual = mesh.visual
    if not visual.defined:
        return None
    if visual.kind == "face":
        colours = visual.face_colors
    elif visual.kind == "vertex":
        colours = visual.vertex_colors[mesh.faces].mean(axis=1)
    else:
        colours = visual.material.main_color
        texture = getattr(visual.material, "image", None) or getattr(visual.material, "baseColorTexture", None)
        if texture is not None and visual.uv is not None:
            colours = visual.to_color().vertex_colors[mesh.faces].mean(axis=1)
    if colours is None:
        return None

    # Exporters disagree on what the alpha 0 of a COLLADA file means; none of them means an invisible robot.
    colours = np.broadcast_to(np.asarray(colours, dtype=float), (len(mesh.faces), 4)).round().astype(np.uint8)
    colours[colours[:, 3] == 0, 3] = 255
    return colours
