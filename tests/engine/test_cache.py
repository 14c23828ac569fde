"""The cache of compiled kernels."""

import os
import signal
import stat
import subprocess
import sys
import time

import numpy as np
import pytest

from robodyn.cli import main
from robodyn.engine.run import kernel as kernels
from robodyn.engine.trace.graph import Graph
from robodyn.engine.trace.program import program
from robodyn.system import cache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv(cache.VARIABLE, str(path))
    return path


def make(factor):
    graph = Graph()
    x = graph.inputs("x", (1,))
    return kernels.Kernel(program(graph, {"x": 1}, {"y": x * factor}))


def value(factor):
    return make(factor)((1,), {"x": np.array([2.0])})[0]["y"].item()


def test_an_entry_is_written_once_and_used(folder, monkeypatch):
    assert value(3.0) == 6.0
    assert cache.usage()[0] == 1
    monkeypatch.setattr(kernels, "object_code", lambda ir: pytest.fail("compiled again"))
    assert value(3.0) == 6.0


def test_what_shapes_the_code_is_in_the_key(folder, monkeypatch):
    value(3.0)
    value(4.0)
    assert cache.usage()[0] == 2
    monkeypatch.setattr(kernels, "cpu", lambda: ("another", "+cpu"))
    assert value(3.0) == 6.0
    assert cache.usage()[0] == 3
    monkeypatch.setattr(kernels, "OPTIONS", "others")
    value(3.0)
    assert cache.usage()[0] == 4
    monkeypatch.setattr(kernels, "version", lambda: ("another", "LLVM"))
    value(3.0)
    assert cache.usage()[0] == 5


def test_entries_are_private(folder):
    value(3.0)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert all(stat.S_IMODE(file.stat().st_mode) == 0o600 for file in folder.iterdir())


@pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:-1] + bytes([b[-1] ^ 1]), lambda b: b"x" * len(b)]
)
def test_a_damaged_entry_is_compiled_anew(folder, damage):
    value(3.0)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert value(3.0) == 6.0
    assert file.read_bytes() == whole


def test_an_entry_under_another_name_is_foreign(folder):
    value(3.0)
    (first,) = folder.iterdir()
    content = first.read_bytes()
    value(4.0)
    second = next(file for file in folder.iterdir() if file != first)
    second.write_bytes(content)
    assert value(4.0) == 8.0


def test_a_folder_that_others_can_write_is_not_trusted(folder):
    folder.mkdir()
    os.chmod(folder, 0o777)
    assert cache.folder() is None
    assert value(3.0) == 6.0
    assert not list(folder.iterdir())


def test_a_folder_of_someone_else_is_not_trusted(folder, monkeypatch):
    value(3.0)
    monkeypatch.setattr(os, "getuid", lambda: os.geteuid() + 1)
    assert cache.folder() is None
    assert value(3.0) == 6.0


def test_an_entry_that_others_could_write_is_compiled_anew(folder):
    """As one may lie in a folder that was open to others before."""
    value(3.0)
    (entry,) = folder.iterdir()
    os.chmod(entry, 0o666)
    assert cache.get(entry.name) is None
    assert value(3.0) == 6.0
    assert stat.S_IMODE(entry.stat().st_mode) == 0o600
    assert cache.get(entry.name) is not None


def test_off(monkeypatch, tmp_path):
    monkeypatch.setenv(cache.VARIABLE, "off")
    assert cache.folder() is None
    assert value(3.0) == 6.0


def test_a_folder_that_cannot_be_made_is_no_cache(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "file" / "cache"))
    assert value(3.0) == 6.0


def test_the_cache_is_bounded_and_drops_what_was_used_longest_ago(folder, monkeypatch):
    monkeypatch.setattr(cache, "LIMIT", 3000)
    names = [cache.key(str(i)) for i in range(6)]
    for i, name in enumerate(names):
        cache.put(name, bytes(900))
        if (folder / name).exists():
            os.utime(folder / name, (i, i))
    assert cache.usage()[1] <= 3000
    assert cache.get(names[5]) == bytes(900)
    assert cache.get(names[0]) is None


def test_clear(folder):
    value(3.0)
    value(4.0)
    number, size = cache.clear()
    assert (number, size > 0) == (2, True)
    assert cache.usage() == (0, 0)


def leave(folder, name, age, size=1000):
    """What a process leaves that was killed in the middle of writing."""
    file = folder / name
    file.write_bytes(bytes(size))
    os.utime(file, (time.time() - age,) * 2)
    return file


def test_what_interrupted_writes_left_is_counted_and_cleared(folder, capsys):
    value(3.0)
    number, size = cache.usage()
    old, new = leave(folder, ".robodyn.a1.part", age=3600), leave(folder, ".robodyn.b2.part", age=5)
    foreign = leave(folder, "notes.part", age=3600)
    assert cache.usage() == (number, size + 2000)
    assert cache.clear() == (number, size + 1000)
    assert not old.exists()
    assert new.exists()  # another process may be at it
    assert foreign.exists()
    assert cache.usage() == (0, 1000)
    os.utime(new, (time.time() - 3600,) * 2)
    assert main(["cache", "--clear"]) == 0
    assert not new.exists()
    assert "0 entries" in capsys.readouterr().out


def test_the_next_entry_cleans_up_behind_an_interrupted_write(folder):
    folder.mkdir(mode=0o700)
    old, new = leave(folder, ".robodyn.a1.part", age=3600), leave(folder, ".robodyn.b2.part", age=5)
    value(3.0)
    assert not old.exists()
    assert new.exists()


def test_a_killed_process_leaves_what_clear_knows(folder):
    """Killed between the write and the rename; the name of what it leaves is the one that is looked for."""
    folder.mkdir(mode=0o700)
    program = (
        "import os, signal; from robodyn.system import cache; "
        "os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL); cache.put(cache.key('x'), bytes(500))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == -signal.SIGKILL
    (left,) = folder.iterdir()
    assert cache.usage()[1] > 500
    os.utime(left, (time.time() - 3600,) * 2)
    assert cache.clear()[1] > 500
    assert not list(folder.iterdir())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs POSIX pipes")
@pytest.mark.parametrize("kind", ["pipe", "link to endless zeros", "folder"])
def test_what_is_no_file_is_no_entry(folder, kind):
    """Nobody waits for the end of a pipe."""
    value(3.0)
    (entry,) = folder.iterdir()
    entry.unlink()
    if kind == "pipe":
        os.mkfifo(entry)
    elif kind == "folder":
        entry.mkdir()
    else:
        entry.symlink_to("/dev/zero")
    assert cache.usage() == (0, 0)
    assert cache.clear() == (0, 0)
    assert value(3.0) == 6.0


def test_files_of_others_are_neither_counted_nor_removed(folder, monkeypatch):
    value(3.0)
    foreign = folder / ("a" * 64)
    foreign.write_bytes(b"kept")
    os.utime(foreign, (0, 0))
    monkeypatch.setattr(cache, "LIMIT", 1)
    value(4.0)
    assert cache.usage()[0] == 1  # the newest stays, whatever its size
    assert cache.clear()[0] == 1
    assert foreign.read_bytes() == b"kept"


def test_parts_of_a_key_do_not_run_together():
    assert cache.key("ab", "c") != cache.key("a", "bc")


def test_what_is_used_counts_as_new(folder):
    name = cache.key("x")
    cache.put(name, b"1")
    os.utime(folder / name, (1, 1))
    cache.get(name)
    assert (folder / name).stat().st_mtime > time.time() - 3600


def test_a_folder_that_the_group_can_write_is_not_trusted(folder):
    folder.mkdir()
    os.chmod(folder, 0o770)
    assert cache.folder() is None
