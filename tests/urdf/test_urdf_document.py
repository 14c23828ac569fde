"""Files and XML: what is not well-formed is refused, and nothing is opened or fetched that a file asks for."""

import io
import subprocess
import sys

import pytest

from robodyn import InputError, UrdfError
from robodyn.urdf import read
from robodyn.urdf.document import parse
from robodyn.urdf.read import values

ROBOT = '<robot name="Rübe"><link name="ä"/></robot>'


def refusal(source):
    with pytest.raises(UrdfError) as caught:
        read(source)
    return str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1", "cp1252"])
def test_the_declared_encoding_counts(load, encoding):
    assert load(f'<?xml version="1.0" encoding="{encoding}"?>{ROBOT}'.encode(encoding)).link_names == ("ä",)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_enough(load, encoding):
    assert load(ROBOT.encode(encoding)).name == "Rübe"


def test_an_open_file_is_a_source():
    assert read(io.BytesIO(ROBOT.encode())).source is None
    assert read(io.StringIO("\ufeff" + ROBOT)).name == "Rübe"
    assert read(io.StringIO('<?xml version="1.0" encoding="latin-1"?>' + ROBOT)).name == "Rübe"  # decoded already


def test_a_file_knows_its_path(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(ROBOT, encoding="utf-8")
    with path.open(encoding="utf-8") as file:
        assert read(path).source == read(str(path)).source == read(file).source == str(path)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "the file is empty"),
        (b" \n ", "the file is empty"),
        (b'<robot name="r">\n<link name="a">\n</robot>', "3: broken XML: mismatched tag, column 3 in <link name='a'> of line 2: repair"),
        (b'<robot name="r"><link name="a"/>\n', "2: broken XML: no element found"),
        (b'<robot name="r"><link name="a"/></robot>\n<robot/>', "2: broken XML: junk after document element"),
        (b'<robot name="r"><link name="a" name="b"/></robot>', "1: broken XML: duplicate attribute"),
        (b'<robot name="r">&who;</robot>', "1: broken XML: undefined entity"),
        (b'<robot name="r"><link name="&#1;"/></robot>', "1: broken XML: reference to invalid character number"),
        (b'<robot name="r"><link name=a/></robot>', "1: broken XML: not well-formed"),
        (bytes(range(256)), "1: broken XML: not well-formed"),
        ("<robot name='ä'/>".encode("latin-1"), "in the encoding that its first line declares?"),
        (b'<?xml version="1.0" encoding="klingon"?><robot/>', "unknown encoding: klingon: save the file as UTF-8"),
        (b'<?xml version="1.0" encoding="shift_jis"?><robot/>', "save the file as UTF-8"),
    ],
)
def test_broken_files_are_refused_and_never_recovered(tmp_path, data, words):
    path = tmp_path / "robot.urdf"
    path.write_bytes(data)
    message = refusal(path)
    assert message.startswith(f"{path}:")
    assert words in message


def test_lone_surrogates_are_refused():
    assert "cannot be decoded" in refusal(io.StringIO('<robot name="\ud800"/>'))


@pytest.mark.parametrize(
    "doctype",
    [
        '[<!ENTITY a "x">]',
        '[<!ENTITY a "xx"><!ENTITY b "&a;&a;"><!ENTITY c "&b;&b;">]',
        '[<!ENTITY a SYSTEM "file:///etc/passwd">]',
        '[<!ENTITY % a SYSTEM "http://localhost/a"> %a;]',
        '[<!ATTLIST link name CDATA "hidden">]',
        'SYSTEM "http://localhost/robot.dtd"',
        'PUBLIC "robot" "http://localhost/robot.dtd"',
    ],
)
def test_entities_are_refused(doctype):
    message = refusal(io.StringIO(f'<?xml version="1.0"?>\n<!DOCTYPE robot {doctype}><robot name="&a;"><link/></robot>'))
    assert message.startswith("<stream>:2: <!DOCTYPE>")
    assert "delete it" in message


def test_comments_instructions_and_namespaces_mean_nothing(load):
    mechanism = load("""<?xml version="1.0"?><?a b?><!-- c --><!DOCTYPE robot>
      <robot xmlns="http://www.ros.org" xmlns:xacro="http://www.ros.org/wiki/xacro" name="r"><!-- c --><?a b?>
        <link name="a"><!-- c --><visual><?a b?><geometry><!-- c --><?a b?><sphere radius="1"/></geometry></visual></link>
        <unbound:prefix/><!-- c -->
      </robot><!-- c --><?a b?>""")
    assert mechanism.links[0].visuals[0].geometry.radius == 1.0


def test_lines_are_counted_beyond_65535():
    assert refusal(io.StringIO('<robot name="r"><link name="a"/>' + "\n" * 70000 + '<link name="a"/></robot>')).startswith(
        "<stream>:70001:"
    )


def test_depth_and_length_do_no_harm():
    deep = 100_000
    assert len(read(io.StringIO(f'<robot name="r"><link name="a">{"<x>" * deep}{"</x>" * deep}</link></robot>')).links) == 1
    assert "broken XML" in refusal(io.StringIO(f'<robot name="r">{"<x>" * deep}'))
    assert "10000 are enough" in refusal(io.StringIO(f'<robot name="{"r" * 11_000_000}"><link name="a"/></robot>'))
    assert len(read(io.StringIO(f'<robot name="r">{"." * 11_000_000}<link name="a"/></robot>')).links) == 1


def test_every_character_that_is_accepted_survives():
    """yourdfpy reads the checked copy with another parser: the two must agree on what a character is."""
    for first in range(1, 0x11000, 0x100):
        for code in range(first, first + 0x100):
            try:
                root = parse(f'<robot name="r{chr(code)}"><link name="a"/></robot>', "r")
            except UrdfError:
                continue
            assert values(root).name == root.get("name"), hex(code)


def test_nothing_is_opened_but_the_robot(tmp_path):
    hostile = tmp_path / "hostile.urdf"
    hostile.write_text("""<?xml version="1.0"?><?xml-stylesheet href="http://localhost/a.xsl"?>
      <robot name="r" xmlns:xi="http://www.w3.org/2001/XInclude" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
        xsi:noNamespaceSchemaLocation="http://localhost/a.xsd"><xi:include href="/etc/passwd"/>
      <link name="a"><visual><geometry><mesh filename="file:///etc/passwd"/></geometry></visual>
        <visual><geometry><mesh filename="http://localhost/a.stl"/></geometry></visual></link></robot>""")
    code = """if True:
      import io, sys
      from robodyn.urdf import read
      read(io.StringIO("<robot name='r'><link name='a'/></robot>"))  # imports what it needs
      sys.addaudithook(lambda event, about: event.split(".")[0] in ("open", "socket", "subprocess", "os") and print(event, about[0]))
      read(sys.argv[1])
    """
    done = subprocess.run([sys.executable, "-c", code, str(hostile)], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["open", str(hostile)]


def test_what_is_no_file_is_named(tmp_path):
    assert "No such file" in refusal(tmp_path / "absent.urdf")
    assert "Is a directory" in refusal(tmp_path)
    assert "null byte" in refusal("a\0b")
    (tmp_path / "latin.urdf").write_bytes(ROBOT.encode("latin-1"))
    with (tmp_path / "latin.urdf").open(encoding="utf-8") as file:
        assert "latin.urdf: cannot be read" in refusal(file)


@pytest.mark.parametrize("source", [None, 3, ROBOT])
def test_what_is_no_source_is_named(source):
    with pytest.raises(InputError, match=r"give a path or an open file|io\.StringIO"):
        read(source)
