"""What a link looks like. The dynamics never read it."""

from dataclasses import dataclass

from ..arithmetic import Array


@dataclass(frozen=True, eq=False)
class Box:
    """Centred on its frame."""

    size: tuple[float, float, float]  # full edge lengths along x, y, z [m]


@dataclass(frozen=True, eq=False)
class Cylinder:
    """Centred on its frame, its axis along z."""

    radius: float  # [m]
    length: float  # [m]


@dataclass(frozen=True, eq=False)
class Sphere:
    """Centred on its frame."""

    radius: float  # [m]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A file of triangles."""

    filename: str  # as the robot file writes it
    path: str | None  # where the file was found; None where it was not
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)


Geometry = Box | Cylinder | Sphere | Mesh


@dataclass(frozen=True, eq=False)
class Visual:
    """One piece of a link's appearance."""

    geometry: Geometry
    rotation: Array  # (3, 3): of the geometry's frame in the link's
    translation: Array  # (3,) [m]
    colour: tuple[float, float, float, float] | None = None  # red, green, blue, alpha in 0…1
    material: str | None = None
    texture: str | None = None
