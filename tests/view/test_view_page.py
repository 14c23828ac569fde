"""The file: one piece, nothing to fetch, nothing that a name could break, the same bytes every time."""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from view_robots import chain, visual

from robodyn.errors import MissingPackageError, RobodynWarning
from robodyn.model import Box, Link
from robodyn.view import page, write_html

HOSTILE = [
    "</script><script>alert(1)</script>",
    "<!--<script>",
    "]]>--><img src=x onerror=alert(1)>",
    "__proto__",
    "constructor",
    "a/b\\c\"d'e&amp;{{data}}${x}\u2028\n",
    "",
    "名前 🤖",
]


class Reader(HTMLParser):
    """Elements of a page and the text of its scripts and title, as a browser's parser sees them."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.scripts, self.title = [], [], ""
        self._inside = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._inside = tag
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._inside = None

    def handle_data(self, data):
        if self._inside == "script":
            self.scripts[-1] += data
        if self._inside == "title":
            self.title += data


def test_the_page_holds_everything_and_fetches_nothing(run, tmp_path):
    write_html(tmp_path / "run.html", run.mechanism, **run.arguments, title="A & B")
    text = (tmp_path / "run.html").read_text("utf-8")
    reader = Reader(text)
    assert reader.title == "A & B"
    assert not [tag for tag, attrs in reader.elements if "src" in attrs or attrs.get("href", "data:,") != "data:,"]
    assert json.loads(reader.scripts[2])["links"] == ["base", "arm", "slide"]

    policy = next(attrs["content"] for tag, attrs in reader.elements if "http-equiv" in attrs)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert not re.search("https?:|unsafe-eval|script-src[^;]*unsafe", policy)
    assert policy.count("sha256-") == 2


def test_the_licences_of_what_the_page_carries_stand_in_it(run, tmp_path):
    write_html(tmp_path / "run.html", run.mechanism, **run.arguments)
    notices = Reader((tmp_path / "run.html").read_text("utf-8")).scripts[0]
    for holder in ("Robin Deits", "Three.js Authors", "dat.gui", "Feross Aboukhadijeh"):
        assert holder in notices


@pytest.mark.parametrize("name", HOSTILE)
def test_names_cannot_break_out(name):
    link = Link(name, visuals=(visual(Box((1.0, 1.0, 1.0))),))
    data = {"links": chain(link).link_names}
    reader = Reader(page.assemble(name, data))
    assert reader.title == name
    assert len(reader.scripts) == 4
    assert json.loads(reader.scripts[2]) == {"links": [name]}
    assert not [tag for tag, _ in reader.elements if tag == "img"]


@pytest.mark.parametrize("text", ["'</script>'", "'</SCRIPT'", "'<!--'", "'<!-- <script>'"])
def test_a_script_is_rewritten_where_it_would_end_its_element(text):
    safe = page._inline(text)
    assert not re.search("</script|<!--", safe, re.IGNORECASE)
    assert safe.replace("\\x3c", "<") == text


def test_the_same_input_gives_the_same_bytes(run, tmp_path):
    for name in ("a.html", "b.html"):
        write_html(tmp_path / name, run.mechanism, **run.arguments)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_a_page_is_the_bundle_and_little_more(run, tmp_path):
    write_html(tmp_path / "run.html", run.mechanism, **run.arguments)
    assert (tmp_path / "run.html").stat().st_size < 920_000


def test_neither_meshcat_nor_trimesh_is_imported_for_primitives(tmp_path):
    code = """
import sys
import numpy as np
from robodyn.joints import Fixed
from robodyn.model import Box, Joint, Link, Mechanism, Visual
from robodyn.view import write_html
link = Link("a", visuals=(Visual(Box((1.0, 1.0, 1.0)), np.eye(3), np.zeros(3)),))
write_html(sys.argv[1], Mechanism("m", (link,), (Joint("ground", Fixed(), -1),)), times=[0.0], poses=np.eye(4)[None, None])
print({"meshcat", "trimesh", "yourdfpy"} & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.html")], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr


def test_a_missing_bundle_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match="pip install meshcat"):
        page.assemble("t", {})

    class Spec:
        submodule_search_locations = (str(tmp_path),)

    monkeypatch.setattr(page, "find_spec", lambda name: Spec)
    with pytest.raises(MissingPackageError, match=re.escape(str(tmp_path))):
        page.assemble("t", {})


def test_a_heavy_page_is_written_with_a_warning(run, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "HEAVY", 1000)
    with pytest.warns(RobodynWarning, match=r"run.html: the page has 1 MB .* lighter meshes"):
        write_html(tmp_path / "run.html", run.mechanism, **run.arguments)
    assert (tmp_path / "run.html").exists()


def test_nothing_is_written_where_the_arrays_do_not_fit(run, tmp_path):
    with pytest.raises(ValueError, match="shape"):
        write_html(tmp_path / "run.html", run.mechanism, times=run.times, poses=np.eye(4))
    assert list(tmp_path.iterdir()) == []
