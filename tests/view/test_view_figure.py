"""Shapes in the page: primitives, mesh files, colours, and what is drawn where a robot has none."""

from base64 import b64decode

import numpy as np
import pytest
import trimesh
from view_robots import ORANGE, chain, visual

from robodyn.arithmetic.vectors import rotation_from_quaternion
from robodyn.errors import RobodynWarning
from robodyn.model import Box, Cylinder, Inertia, Link, Mesh, Sphere
from robodyn.view.figure import figure
from robodyn.view.meshes import read

EPS32 = float(np.finfo(np.float32).eps)


def mesh_link(path, name="link", scale=(1.0, 1.0, 1.0), colour=None):
    return Link(name, visuals=(visual(Mesh(f"package://robot/{path.name}", str(path), scale), colour),))


def vertices(part):
    return np.frombuffer(b64decode(part["vertices"]), "<f4").reshape(-1, 3)


def triangles(part):
    return np.frombuffer(b64decode(part["triangles"]), "<u4").reshape(-1, 3)


def extent(parts):
    points = np.concatenate([vertices(part) for part in parts])
    return points.max(axis=0) - points.min(axis=0)


def test_primitives_keep_their_sizes_places_and_colours(run):
    record = figure(run.mechanism)
    assert record["links"] == ("base", "arm", "slide")
    assert record["meshes"] == []
    (base,), (box, sphere), (cylinder,) = record["shapes"]
    assert (base["form"], base["size"], base["colour"]) == ("box", (0.5, 0.5, 0.1), None)
    assert (box["form"], box["colour"]) == ("box", ORANGE)
    assert (sphere["form"], sphere["size"]) == ("sphere", (0.1,))
    assert (cylinder["form"], cylinder["size"], cylinder["colour"][3]) == ("cylinder", (0.1, 0.4), 0.5)
    assert base["place"] == [0, 0, 0, 1, 0, 0, 0]


@pytest.mark.parametrize("kind", ["stl", "STL", "obj", "dae", "ply", "glb"])
def test_a_mesh_file_becomes_triangles_over_distinct_vertices(tmp_path, kind):
    path = tmp_path / f"brick.{kind}"
    path.write_bytes(_bytes(trimesh.creation.box((0.1, 0.2, 0.4)).export(file_type=kind.lower())))
    (part,) = read(str(path))
    assert len(vertices(part)) == 8
    assert len(triangles(part)) == 12
    assert abs(extent([part]) - [0.1, 0.2, 0.4]).max() <= EPS32

    # The corners run counterclockwise, seen from outside: the volume enclosed is positive.
    a, b, c = vertices(part)[triangles(part)].astype(float).swapaxes(0, 1)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(0.008, rel=8 * EPS32)


def _bytes(data):
    return data.encode() if isinstance(data, str) else data


def test_triangles_without_area_are_left_out(tmp_path):
    path = tmp_path / "sliver.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 3\nf 1 2 4\n")
    (part,) = read(str(path))
    assert triangles(part).shape == (1, 3)


def test_a_file_shown_twice_stands_in_the_page_once(tmp_path):
    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere().export(path)
    record = figure(chain(mesh_link(path, "left"), mesh_link(path, "right", scale=(1.0, -1.0, 1.0))))
    assert len(record["meshes"]) == 1
    (left,), (right,) = record["shapes"]
    assert left["mesh"] == right["mesh"] == 0
    assert (left["size"], right["size"]) == ((1.0, 1.0, 1.0), (1.0, -1.0, 1.0))


def test_colours_come_from_the_material_of_an_obj(tmp_path):
    (tmp_path / "paint.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    path = tmp_path / "two.obj"
    path.write_text("mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n")
    assert sorted(tuple(part["colour"]) for part in read(str(path))) == [(0, 0, 1, 1), (1, 0, 0, 1)]


def test_colours_come_from_the_faces_where_they_differ(tmp_path):
    box = trimesh.creation.box()
    box.visual.face_colors = [[10 * i, 20, 30, 255] for i in range(12)]
    path = tmp_path / "motley.ply"
    box.export(path)
    (part,) = read(str(path))
    colours = np.frombuffer(b64decode(part["colours"]), "u1").reshape(-1, 3)
    assert sorted(colours.tolist()) == [[10 * i, 20, 30] for i in range(12)]


def test_colours_stay_with_their_faces_where_others_are_left_out(tmp_path):
    corners, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 1], [0, 2, 3]]
    sheet = trimesh.Trimesh(corners, faces, face_colors=[[250, 0, 0, 255], [0, 250, 0, 255], [0, 0, 250, 255]], process=False)
    path = tmp_path / "sheet.ply"
    sheet.export(path)
    (part,) = read(str(path))
    assert np.frombuffer(b64decode(part["colours"]), "u1").reshape(-1, 3).tolist() == [[250, 0, 0], [0, 0, 250]]


def test_colours_come_from_a_texture(tmp_path):
    from PIL import Image

    picture = Image.new("RGB", (4, 4), (0, 255, 0))
    flag = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    flag.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [0, 1]], image=picture)
    path = tmp_path / "flag.glb"
    flag.export(path)
    (part,) = read(str(path))
    assert part["colour"] == [0, 1, 0, 1]


def test_a_mesh_without_colours_has_none(tmp_path):
    path = tmp_path / "plain.stl"
    trimesh.creation.box().export(path)
    assert read(str(path))[0].keys() == {"vertices", "triangles"}


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
  <library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong>
    <diffuse><color>0.2 0.4 0.6 1</color></diffuse><transparent opaque="RGB_ZERO"><color>0 0 0 0</color></transparent>
  </phong></technique></profile_COMMON></effect></library_effects>
  <library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
  <library_geometries><geometry id="g"><mesh>
    <source id="s"><float_array id="f" count="9">0 0 0 10 0 0 0 20 40</float_array>
      <technique_common><accessor source="#f" count="3" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
    <triangles count="1" material="paint"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="w">
    <node><translate>100 0 0</translate><node><scale>2 2 2</scale>
      <instance_geometry url="#g"><bind_material><technique_common>
        <instance_material symbol="paint" target="#m"/></technique_common></bind_material></instance_geometry>
    </node></node>
    <node><instance_geometry url="#g"/></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#w"/></scene>
</COLLADA>
"""


def test_collada_counts_its_unit_and_its_nodes_but_not_its_up_axis(tmp_path):
    path = tmp_path / "tree.dae"
    path.write_text(COLLADA)
    near, far = sorted(read(str(path)), key=lambda part: vertices(part)[:, 0].max())
    assert abs(vertices(near) - [[0, 0, 0], [0, 0.2, 0.4], [0.1, 0, 0]]).max() <= EPS32
    assert abs(vertices(far) - [[1, 0, 0], [1, 0.4, 0.8], [1.2, 0, 0]]).max() <= 2 * EPS32
    assert far["colour"] == [51 / 255, 102 / 255, 153 / 255, 1.0]  # not invisible, whatever its alpha was meant to say


@pytest.mark.parametrize("content", [b"", b"solid nothing\nendsolid nothing\n", b"\x00\xff" * 10, b"\x00" * 80 + b"\xff" * 4])
def test_a_damaged_mesh_is_a_warning_that_names_link_file_and_reason(tmp_path, content):
    path = tmp_path / "broken.stl"
    path.write_bytes(content)
    whole = Link("whole", visuals=(visual(Box((1.0, 1.0, 1.0))),))
    with pytest.warns(RobodynWarning, match="link 'hand': the mesh 'package://robot/broken.stl' is not drawn: .+"):
        record = figure(chain(whole, mesh_link(path, "hand")))
    assert [len(own) for own in record["shapes"]] == [1, 0]


def test_coordinates_that_are_not_finite_are_a_warning(tmp_path):
    path = tmp_path / "nan.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n")
    with pytest.warns(RobodynWarning, match="not finite"):
        figure(chain(mesh_link(path)))


def test_a_missing_mesh_is_a_warning_for_every_link_that_wants_it():
    lost = visual(Mesh("package://robot/lost.dae", None))
    with pytest.warns(RobodynWarning) as warned:
        figure(chain(Link("left", visuals=(lost,)), Link("right", visuals=(lost,))))
    text = "the mesh 'package://robot/lost.dae' is not drawn: the file was not found"
    assert [str(w.message) for w in warned] == [f"link 'left': {text}", f"link 'right': {text}"]


def test_a_robot_without_visuals_is_a_skeleton_from_joint_to_joint():
    tip = Inertia.about_centre(1.0, np.array([0.1, 0.0, 0.0]), np.eye(3))
    record = figure(chain(Link("base"), Link("arm"), Link("tip", tip)))
    for own, end in zip(record["shapes"], ([0, 0, 0.2], [0, 0, 0.2], [0.1, 0, 0]), strict=True):
        joint, *axes, bone = own
        assert joint["form"] == "sphere"
        assert len(axes) == 3
        middle, R = np.array(bone["place"][:3]), rotation_from_quaternion(np.array(bone["place"][3:]))
        assert middle + R[:, 2] * bone["size"][1] / 2 == pytest.approx(np.array(end), abs=1e-15)  # 4 eps of 0.2 m
        assert middle - R[:, 2] * bone["size"][1] / 2 == pytest.approx(np.zeros(3), abs=1e-15)


def test_a_single_link_without_anything_is_still_seen():
    (own,) = figure(chain(Link("point")))["shapes"]
    assert [shape["form"] for shape in own] == ["sphere", "cylinder", "cylinder", "cylinder"]


def test_every_geometry_is_drawn():
    link = Link("all", visuals=tuple(visual(g) for g in (Box((1.0, 1.0, 1.0)), Cylinder(1.0, 1.0), Sphere(1.0))))
    assert [shape["form"] for shape in figure(chain(link))["shapes"][0]] == ["box", "cylinder", "sphere"]
