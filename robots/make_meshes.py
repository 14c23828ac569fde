"""Writes robots/meshes/ur5e/*.stl, the shapes that ur5e.urdf shows.

Our own shapes, not the vendor's CAD: tubes, and joint housings with rounded edges, laid along the joint axes at the
published Denavit-Hartenberg distances. Every solid is a closed surface of revolution, and solids of one link simply
overlap, so no boolean operation is needed and two runs write the same bytes.

    python robots/make_meshes.py            # needs numpy and trimesh

Each mesh is given in its link's frame, in metres.
"""

from pathlib import Path

import numpy as np
import trimesh

SECTIONS = 40  # facets around an axis of revolution
FILLET_STEPS = 3  # facets across a rounded edge

X, Y, Z = np.eye(3)


def frame(axis):
    """Columns x, y, z of a right-handed frame whose z is the given coordinate direction."""
    x = np.roll(np.abs(axis), 1)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def revolve(profile, axis=Z, origin=(0.0, 0.0, 0.0)):
    """A closed solid of revolution.

    profile: (n, 2) points (radius, height along the axis), from the axis (radius 0) upwards and back to the axis.
    axis: direction of the axis, one of +-X, +-Y, +-Z; height is counted from origin.
    """
    profile = np.asarray(profile, dtype=float)
    angle = 2.0 * np.pi * np.arange(SECTIONS) / SECTIONS
    inner = profile[1:-1]

    # Vertices: the two poles, then one ring for each inner point of the profile.
    rings = np.stack(
        [
            inner[:, :1] * np.cos(angle),
            inner[:, :1] * np.sin(angle),
            np.broadcast_to(inner[:, 1:], (len(inner), SECTIONS)),
        ],
        axis=-1,
    )
    poles = [[0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]]
    vertices = np.vstack([poles, rings.reshape(-1, 3)])

    # Faces, counter-clockwise from outside: a fan at each pole, two triangles for each cell between rings.
    here = np.arange(SECTIONS)
    there = np.roll(here, -1)
    first, last = 2, 2 + (len(inner) - 1) * SECTIONS
    faces = [
        np.stack([np.zeros_like(here), first + there, first + here], axis=1),
        np.stack([np.ones_like(here), last + here, last + there], axis=1),
    ]
    for ring in range(len(inner) - 1):
        low, high = 2 + ring * SECTIONS, 2 + (ring + 1) * SECTIONS
        faces.append(np.stack([low + here, low + there, high + there], axis=1))
        faces.append(np.stack([low + here, high + there, high + here], axis=1))

    mesh = trimesh.Trimesh(vertices @ frame(axis).T + np.asarray(origin), np.vstack(faces), process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    return mesh


def housing(radius, low, high, axis=Z, origin=(0.0, 0.0, 0.0), low_fillet=0.004, high_fillet=0.004):
    """A cylinder from low to high along its axis, both edges rounded."""
    turn = np.linspace(0.0, np.pi / 2.0, FILLET_STEPS + 1)
    bottom = np.stack([radius - low_fillet * (1 - np.sin(turn)), low + low_fillet * (1 - np.cos(turn))], axis=1)
    top = np.stack([radius - high_fillet * (1 - np.cos(turn)), high - high_fillet * (1 - np.sin(turn))], axis=1)
    return revolve(np.vstack([[0.0, low], bottom, top, [0.0, high]]), axis, origin)


def tube(stations, axis, origin=(0.0, 0.0, 0.0)):
    """A tube through the stations (radius, height)."""
    stations = np.asarray(stations, dtype=float)
    return revolve(np.vstack([[0.0, stations[0, 1]], stations, [0.0, stations[-1, 1]]]), axis, origin)


def lid(radius, low, high, axis=Z, origin=(0.0, 0.0, 0.0)):
    """The rounded lid of a joint, its curved face at high."""
    rise = high - low
    profile = [
        [0.0, low],
        [radius, low],
        [radius, low + 0.40 * rise],
        [radius - 0.35 * rise, low + 0.75 * rise],
        [radius - 1.10 * rise, high],
        [0.0, high],
    ]
    return revolve(profile, axis, origin)


def ur5e():
    """Name of the STL file -> solids of that mesh. z runs along the joint axis, x against the arm."""
    elbow, wrist = (-0.425, 0.0, 0.0), (-0.3922, 0.0, 0.0)
    return {
        # Foot and first housing.
        "base": [
            housing(0.0745, 0.000, 0.014, low_fillet=0.001, high_fillet=0.003),
            housing(0.0610, 0.010, 0.0975),
        ],
        # An upright barrel on the pan axis, and across it (along -y) the barrel of the shoulder.
        "shoulder": [
            housing(0.0610, -0.0635, 0.030),
            housing(0.0610, -0.062, 0.069, -Y),
        ],
        "shoulder_lid": [lid(0.0585, 0.062, 0.074, Y)],
        # Shoulder housing, tube and elbow housing, all 138 mm beside the shoulder frame.
        "upper_arm": [
            housing(0.0610, 0.0725, 0.200),
            tube([[0.0540, 0.0], [0.0520, 0.075], [0.0520, 0.35], [0.0540, 0.425]], -X, (0.0, 0.0, 0.138)),
            housing(0.0590, 0.0725, 0.198, origin=elbow),
        ],
        "upper_arm_lids": [lid(0.0585, 0.200, 0.212), lid(0.0565, 0.198, 0.210, origin=elbow)],
        # Elbow housing, tapering tube and wrist end, 7 mm beside the elbow axis' origin.
        "forearm": [
            housing(0.0590, -0.052, 0.069),
            tube([[0.0480, 0.0], [0.0460, 0.070], [0.0400, 0.33], [0.0400, 0.3922]], -X, (0.0, 0.0, 0.007)),
            housing(0.0430, -0.040, 0.052, origin=wrist),
        ],
        "forearm_lids": [lid(0.0565, 0.052, 0.064, -Z), lid(0.0405, 0.040, 0.049, -Z, wrist)],
        # Two equal wrist pieces: a barrel on their own axis, a short barrel towards the next one.
        "wrist_1": [
            housing(0.0430, -0.078, 0.044),
            housing(0.0430, -0.020, 0.046, -Y),
        ],
        "wrist_1_lid": [lid(0.0405, 0.044, 0.053)],
        "wrist_2": [
            housing(0.0430, -0.0505, 0.044),
            housing(0.0430, -0.020, 0.046, Y),
        ],
        "wrist_2_lid": [lid(0.0405, 0.044, 0.053)],
        # The turning flange.
        "wrist_3": [housing(0.0375, -0.0505, -0.0045), housing(0.0315, -0.0055, 0.0, high_fillet=0.001)],
    }


def main():
    folder = Path(__file__).resolve().parent / "meshes" / "ur5e"
    folder.mkdir(parents=True, exist_ok=True)
    for name, solids in ur5e().items():
        mesh = trimesh.util.concatenate(solids)
        path = folder / f"{name}.stl"
        path.write_bytes(trimesh.exchange.stl.export_stl(mesh))
        print(f"{path.relative_to(folder.parents[1])}: {len(mesh.faces)} triangles, {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
