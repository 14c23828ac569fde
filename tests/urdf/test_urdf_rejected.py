"""What a robot cannot be: each problem names the file, the line, the element, the condition and the remedy."""

import pytest

from robodyn import UrdfError

INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def link(inside):
    return f'<robot name="r">\n<link name="a">\n{inside}\n</link></robot>'


def inertial(inside):
    return link(f"<inertial>{inside}</inertial>")


def shape(inside):
    return link(f"<visual><geometry>\n{inside}</geometry></visual>")


def joint(inside, kind='type="revolute"', ends='<parent link="a"/><child link="b"/>'):
    return f'<robot name="r"><link name="a"/><link name="b"/>\n<joint name="j" {kind}>{ends}\n{inside}</joint></robot>'


def tree(*joints, links="abcd"):
    lines = [f'<link name="{name}"/>' for name in links]
    lines += [f'<joint name="{name}" type="fixed"><parent link="{p}"/><child link="{c}"/></joint>' for name, p, c in joints]
    return '<robot name="r">' + "\n".join(lines) + "</robot>"


def mimics(*pairs, kinds=()):
    """Joints j0, j1, … in a row; pairs say who follows whom."""
    follow = {a: f'<mimic joint="{b}"/>' for a, b in pairs}
    links = "".join(f'<link name="l{i}"/>' for i in range(5))
    joints = [
        f'<joint name="j{i}" type="{dict(kinds).get(f"j{i}", "revolute")}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f"{follow.get(f'j{i}', '')}</joint>"
        for i in range(4)
    ]
    return f'<robot name="r">{links}\n' + "\n".join(joints) + "</robot>"


# name: (XML, line, element, words of the condition and of the remedy)
CORPUS = {
    # the robot
    "robot without a name": ('<!-- c -->\n<robot><link name="a"/></robot>', 2, "<robot>", ["has no name", 'write name="…"']),
    "robot with an empty name": ('<robot name=" "><link name="a"/></robot>', 1, "<robot name=' '>", ["is empty", "write a name"]),
    "no link": ('<robot name="r">\n</robot>', 1, "<robot name='r'>", ["has no link", "add <link"]),
    "SDF": ('<?xml version="1.0"?>\n<sdf version="1.6"/>', 2, "<sdf>", ["is an SDF file", "give a URDF"]),
    "MJCF": ('<mujoco model="m"/>', 1, "<mujoco>", ["MJCF", "give a URDF"]),
    "another root": ("<html/>", 1, "<html>", ["something else", "<robot name=…>"]),
    "xacro": (
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<link name="a"/>\n<xacro:arm/><xacro:arm/></robot>',
        3,
        "<xacro:arm> in <robot name='r'>",
        ["one of 2 xacro tags", "run `xacro"],
    ),
    "xacro in a value": (link('<inertial><mass value="${m}"/>' + INERTIA + "</inertial>"), 3, "<mass> in <link name='a'>", ["run `xacro"]),
    # links
    "link without a name": (
        '<robot name="r">\n<link/><link name="a"/></robot>',
        2,
        "<link> in <robot name='r'>",
        ["no name", "write name"],
    ),
    "two links of one name": (tree(links="aa"), 2, "<link name='a'>", ["line 1", "rename"]),
    "two inertials": (
        link(f'<inertial><mass value="1"/>{INERTIA}</inertial>\n' * 2),
        4,
        "<inertial> in <link name='a'>",
        ["number 2", "keep one"],
    ),
    "two origins": (
        inertial(f'<origin xyz="0 0 0"/>\n<origin xyz="1 0 0"/><mass value="1"/>{INERTIA}'),
        4,
        "<origin> in <link name='a'>",
        ["keep one"],
    ),
    "no mass": (inertial(INERTIA), 3, "<inertial> in <link name='a'>", ["has no <mass>", "add <mass value="]),
    "mass without value": (inertial("<mass>1</mass>" + INERTIA), 3, "<mass> in <link name='a'>", ["has no value", 'write value="0.5"']),
    "no inertia": (inertial('<mass value="1"/>'), 3, "<inertial> in <link name='a'>", ["no <inertia>", "add <inertia ixx="]),
    "no ixx": (inertial('<mass value="1"/><inertia iyy="1" izz="1"/>'), 3, "<inertia> in <link name='a'>", ["no ixx", 'write ixx="']),
    "no iyy": (inertial('<mass value="1"/><inertia ixx="1" izz="1"/>'), 3, "<inertia> in <link name='a'>", ["no iyy", 'write iyy="']),
    "no izz": (inertial('<mass value="1"/><inertia ixx="1" iyy="1"/>'), 3, "<inertia> in <link name='a'>", ["no izz", 'write izz="']),
    "negative mass": (inertial('<mass value="-1"/>' + INERTIA), 3, "<mass> in <link name='a'>", ["value='-1'", "at least 0"]),
    # numbers
    "nan": (inertial('<mass value="nan"/>' + INERTIA), 3, "<mass>", ["'nan' where a finite number", "write it as"]),
    "inf": (inertial('<mass value="inf"/>' + INERTIA), 3, "<mass>", ["'inf' where a finite number", "write it as"]),
    "overflow": (inertial('<mass value="1e999"/>' + INERTIA), 3, "<mass>", ["beyond 1e+100", "SI units"]),
    "words": (inertial('<mass value="one"/>' + INERTIA), 3, "<mass>", ["'one' where", "write it as"]),
    "underscore": (inertial('<mass value="1_0"/>' + INERTIA), 3, "<mass>", ["'1_0' where", "write it as"]),
    "other digits": (inertial('<mass value="١"/>' + INERTIA), 3, "<mass>", ["where a finite number", "write it as"]),
    "empty number": (inertial('<mass value=""/>' + INERTIA), 3, "<mass>", ["0 numbers", "write 1"]),
    "comma": (inertial('<mass value="1,5"/>' + INERTIA), 3, "<mass>", ["'1,5' where", "write it as 0.5"]),
    "two of three": (joint('<origin xyz="0 0"/>' + LIMIT), 3, "<origin> in <joint name='j'>", ["2 numbers", "write 3"]),
    "four of three": (joint('<origin rpy="0 0 0 1"/>' + LIMIT), 3, "<origin> in <joint name='j'>", ["4 numbers", "write 3"]),
    "quaternion": (joint('<origin quat_xyzw="0 0 0 1"/>' + LIMIT), 3, "<origin> in <joint name='j'>", ["not read", "rpy"]),
    "commas between": (shape('<box size="1,2,3"/>'), 4, "<box> in <link name='a'>", ["'1,2,3' where"]),
    "long number": (inertial(f'<mass value="{"1" * 20000}"/>' + INERTIA), 3, "<mass>", ["20000 characters", "are enough"]),
    # shapes
    "box": (shape("<box/>"), 4, "<box> in <link name='a'>", ["no size", 'write size="0.5 0.5 0.5"']),
    "negative box": (shape('<box size="1 -1 1"/>'), 4, "<box> in <link name='a'>", ["below 0", "at least 0"]),
    "negative sphere": (shape('<sphere radius="-1"/>'), 4, "<sphere> in <link name='a'>", ["below 0", "at least 0"]),
    "cylinder": (shape('<cylinder radius="1"/>'), 4, "<cylinder> in <link name='a'>", ["no length", "write length"]),
    "mesh": (shape("<mesh/>"), 4, "<mesh> in <link name='a'>", ["no filename", "write filename"]),
    "mesh without a name": (shape('<mesh filename=""/>'), 4, "<mesh> in <link name='a'>", ["is empty", "write a name"]),
    "scale": (shape('<mesh filename="m.stl" scale="1 1"/>'), 4, "<mesh> in <link name='a'>", ["2 numbers", "write 1 or 3"]),
    "two shapes": (shape('<sphere radius="1"/><box size="1 1 1"/>'), 3, "<geometry> in <link name='a'>", ["2 shapes", "one <visual>"]),
    "colour": (
        '<robot name="r"><link name="a"/>\n<material name="m"><color rgba="1 1 1"/></material></robot>',
        2,
        "<color> in <material name='m'>",
        ["3 numbers", "write 4"],
    ),
    # joints
    "joint without a name": (
        '<robot name="r"><link name="a"/>\n<joint type="fixed"><parent link="a"/><child link="a"/></joint></robot>',
        2,
        "<joint> in <robot name='r'>",
        ["no name", "write name"],
    ),
    "two joints of one name": (tree(("j", "a", "b"), ("j", "b", "c"), links="abc"), 5, "<joint name='j'>", ["line 4", "rename"]),
    "ground": (tree(("ground", "a", "b"), links="ab"), 3, "<joint name='ground'>", ["carries the root link", "rename"]),
    "no type": (joint(LIMIT, kind=""), 2, "<joint name='j'>", ["has no type", "write type="]),
    "unknown type": (joint(LIMIT, kind='type="ball"'), 2, "<joint name='j'>", ["type='ball' is unknown", "write fixed, revolute"]),
    "misspelt type": (joint(LIMIT, kind='type="revolut"'), 2, "<joint name='j'>", ["type='revolut'", "did you mean 'revolute'?"]),
    "no parent": (joint("", ends='<child link="b"/>'), 2, "<joint name='j'>", ["no <parent>", "add <parent link="]),
    "no child": (joint("", ends='<parent link="a"/>'), 2, "<joint name='j'>", ["no <child>", "add <child link="]),
    "parent without link": (joint("", ends='<parent/><child link="b"/>'), 2, "<parent> in <joint name='j'>", ["no link", "write link="]),
    "two parents": (
        joint("", ends='<parent link="a"/><parent link="b"/><child link="b"/>'),
        2,
        "<parent> in <joint name='j'>",
        ["number 2", "keep one"],
    ),
    "unknown parent": (joint("", ends='<parent link="A"/><child link="b"/>'), 2, "<parent> in <joint name='j'>", ["did you mean 'a'?"]),
    "unknown child": (joint("", ends='<parent link="a"/><child link="?"/>'), 2, "<child> in <joint name='j'>", ["'?'", "name a link"]),
    "two axes": (joint('<axis xyz="0 0 1"/>\n<axis xyz="1 0 0"/>'), 4, "<axis> in <joint name='j'>", ["number 2", "keep one"]),
    "zero axis": (joint('<axis xyz="0 0 0"/>'), 3, "<axis> in <joint name='j'>", ["length 0", 'as in xyz="0 0 1"']),
    "tiny axis": (joint('<axis xyz="0 0 1e-300"/>'), 3, "<axis> in <joint name='j'>", ["1e-300", "no direction"]),
    "small axis": (joint('<axis xyz="0 0 1e-12"/>'), 3, "<axis> in <joint name='j'>", ["length 1e-12", "no direction"]),
    "huge axis": (joint('<axis xyz="0 0 1e12"/>'), 3, "<axis> in <joint name='j'>", ["length 1e+12", "no direction"]),
    "axis without xyz": (joint("<axis/>"), 3, "<axis> in <joint name='j'>", ["no xyz", 'write xyz="']),
    "zero axis of a plane": (joint('<axis xyz="0 0 0"/>', kind='type="planar"'), 3, "<axis>", ["length 0"]),
    "limits": (joint('<limit lower="1" upper="-1"/>'), 3, "<limit> in <joint name='j'>", ["lower=1 above upper=-1", "exchange"]),
    "one limit": (joint('<limit upper="-1"/>'), 3, "<limit> in <joint name='j'>", ["lower=0 above upper=-1", "exchange"]),
    "nan limit": (joint('<limit upper="nan"/>'), 3, "<limit> in <joint name='j'>", ["'nan' where"]),
    "negative damping": (joint('<dynamics damping="-1"/>'), 3, "<dynamics> in <joint name='j'>", ["below 0", "at least 0"]),
    "negative friction": (joint('<dynamics friction="-1"/>'), 3, "<dynamics> in <joint name='j'>", ["below 0", "at least 0"]),
    # the tree
    "two roots": (tree(("j", "a", "b"), links="abc"), 3, "<link name='c'>", ["second root beside <link name='a'> in line 1", "delete it"]),
    "two parents of a link": (
        tree(("i", "a", "b"), ("j", "a", "c"), ("k", "b", "c"), links="abc"),
        6,
        "<joint name='k'>",
        ["carries the link 'c', as does <joint name='j'> in line 5", "delete one"],
    ),
    "itself": (tree(("j", "b", "b"), links="ab"), 3, "<joint name='j'>", ["closes a loop of joints, 'j'", "cut it"]),
    "loop": (
        tree(("j", "a", "b"), ("k", "b", "c"), ("l", "c", "a"), links="abc"),
        4,
        "<joint name='j'>",
        ["closes a loop of joints, 'j' → 'l' → 'k'", "cut it"],
    ),
    "loop beside the tree": (tree(("j", "c", "b"), ("k", "b", "c"), links="abc"), 4, "<joint name='j'>", ["closes a loop"]),
    # mimics
    "unknown leader": (mimics(("j1", "J0")), 3, "<mimic> in <joint name='j1'>", ["follows joint='J0'", "did you mean 'j0'?"]),
    "no leader": (mimics().replace("</joint>", "<mimic/></joint>", 1), 2, "<mimic> in <joint name='j0'>", ["no joint", "write joint="]),
    "own leader": (mimics(("j1", "j1")), 3, "<joint name='j1'>", ["follows itself, 'j1' → 'j1'", "lead"]),
    "leaders in a circle": (mimics(("j0", "j2"), ("j2", "j0"), ("j1", "j0")), 2, "<joint name='j0'>", ["'j0' → 'j2' → 'j0'", "lead"]),
    "leader that leads into a circle": (
        mimics(("j0", "j2"), ("j2", "j3"), ("j3", "j2")),
        4,
        "<joint name='j2'>",
        ["itself, 'j2' → 'j3' → 'j2'"],
    ),
    "leader with three freedoms": (
        mimics(("j1", "j0"), kinds=[("j0", "planar")]),
        3,
        "<mimic> in <joint name='j1'>",
        ["revolute joint 'j1' with planar joint 'j0'", "one coordinate"],
    ),
    "follower with three freedoms": (mimics(("j1", "j0"), kinds=[("j1", "spherical")]), 3, "<mimic>", ["spherical joint 'j1'"]),
}


@pytest.mark.parametrize("name", CORPUS)
def test_the_problem_is_named(load, tmp_path, name):
    xml, line, element, words = CORPUS[name]
    with pytest.raises(UrdfError) as caught:
        load(xml)
    places = [text.strip() for text in str(caught.value).splitlines() if f"robot.urdf:{line}: {element}" in text]
    assert places, caught.value
    assert places[0].startswith(str(tmp_path))
    assert any(all(word in text for word in words) for text in places), caught.value


@pytest.mark.parametrize("name", CORPUS)
def test_nothing_else_is_blamed(load, name):
    """One mistake is one problem, even where others could follow from it."""
    xml, *_ = CORPUS[name]
    with pytest.raises(UrdfError) as caught:
        load(xml)
    assert "problems:" not in str(caught.value)


def test_all_problems_come_at_once_in_the_order_of_the_file(load):
    xml = """<robot name="r">
      <link name="a"><inertial><mass value="-1"/><inertia ixx="nan" iyy="1" izz="1"/></inertial></link>
      <link name="b"/>
      <joint name="j" type="revolute"><parent link="a"/><child link="b"/>
        <axis xyz="0 0 0"/>
        <limit lower="1" upper="0"/>
        <mimic joint="nobody"/>
      </joint>
      <joint name="k" type="planar"><parent link="a"/><child link="b"/><dynamics damping="-1"/></joint>
    </robot>"""
    with pytest.raises(UrdfError) as caught:
        load(xml)
    head, *lines = str(caught.value).splitlines()
    assert "robot.urdf has 7 problems:" in head
    assert [int(text.split("robot.urdf:")[1].split(":")[0]) for text in lines] == [2, 2, 5, 6, 7, 9, 9]


def test_hostile_names_are_shown_escaped(load):
    with pytest.raises(UrdfError) as caught:
        load('<robot name="r"><link name="\x9b31m"/><link name="\x9b31m"/></robot>')
    assert r"\x9b31m" in str(caught.value)
