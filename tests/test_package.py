"""The package as a whole: quick to import, layered, documented, with nothing public that is not there."""

import ast
import functools
import importlib
import inspect
import pkgutil
import subprocess
import sys
import textwrap
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

import robodyn as rd
from robodyn import errors
from robodyn.arithmetic import EPS
from robodyn.cli import COMMANDS

PACKAGE = Path(rd.__file__).parent
MODULES = sorted(module.name for module in pkgutil.walk_packages([str(PACKAGE)], "robodyn."))
FILES = {
    ".".join(("robodyn", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in PACKAGE.rglob("*.py")
}


def child(program):
    """The standard output of a fresh interpreter."""
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60).stdout


# --- import ------------------------------------------------------------------------------------------------------------

HEAVY = {"yourdfpy", "trimesh", "meshcat", "lxml", "scipy", "matplotlib", "mpmath", "rich", "llvmlite", "pinocchio", "numpy"}


def test_import_is_quick():
    """Under 0.3 s; the best of three, because other processes take their share of the machine."""
    program = "import time; t = time.perf_counter(); import robodyn; print(time.perf_counter() - t)"
    assert min(float(child(program)) for _ in range(3)) < 0.3


def test_import_brings_nothing_heavy():
    loaded = child("import sys; import robodyn; print(*{name.partition('.')[0] for name in sys.modules})").split()
    assert not HEAVY & set(loaded)


@pytest.mark.parametrize(
    ("use", "allowed"),
    [
        ("robodyn.Scene", {"numpy"}),
        ("robodyn.random_robot", {"numpy"}),
        ("robodyn.load", {"numpy"}),
        ("robodyn.loads", {"numpy"}),
        ("robodyn.simulate", {"numpy", "scipy"}),
        ("robodyn.Scene(robodyn.random_robot(__import__('numpy').random.default_rng(0), 2)).equations()", {"numpy"}),
    ],
)
def test_each_name_brings_only_what_it_needs(use, allowed):
    loaded = child(f"import sys; import robodyn; {use}; print(*{{name.partition('.')[0] for name in sys.modules}})").split()
    assert not (HEAVY - allowed) & set(loaded)


def test_import_prints_nothing_and_warns_of_nothing():
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", "import robodyn; robodyn.simulate"], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.parametrize("module", MODULES)
def test_every_module_can_be_imported_first(module):
    """No module leans on another having been imported before: what it needs it imports."""
    if any(part.startswith("_") for part in module.split(".")):
        pytest.skip("not meant to be imported")
    importlib.import_module(module)


def test_no_circles():
    """A few modules imported alone in a fresh interpreter: each an entrance of its own."""
    for module in (
        "robodyn.loads",
        "robodyn.formalism.reactions",
        "robodyn.simulation.storage",
        "robodyn.cli",
        "robodyn.view",
        "robodyn.simulation",
    ):
        child(f"import {module}")


# --- public names ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", rd.__all__)
def test_every_public_name_resolves(name):
    value = getattr(rd, name)
    assert name in dir(rd)
    assert value is getattr(rd, name)
    if inspect.isclass(value):
        assert value.__name__ == name


def test_nothing_but_public_names_is_shown():
    shown = {name for name in dir(rd) if not (name.startswith("__") and name.endswith("__"))}
    assert shown == set(rd.__all__) - {"__version__"}


def test_names_that_are_not_there():
    with pytest.raises(AttributeError, match="'robodyn' has no attribute 'Robott'"):
        rd.Robott  # noqa: B018


def test_type_checkers_see_the_public_names():
    """What `__getattr__` serves at run time stands under TYPE_CHECKING for those who read the source."""
    tree = ast.parse(FILES["robodyn"].read_text("utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    seen = {alias.asname or alias.name for node in block.body for alias in node.names}
    assert seen == set(rd.__all__) - {"__version__"}


def test_types_are_packaged():
    assert resources.files("robodyn").joinpath("py.typed").is_file()
    for name in ("page.html", "page.css"):
        assert resources.files("robodyn.view").joinpath(name).is_file()


# --- layers ------------------------------------------------------------------------------------------------------------


def imports(module):
    """Every module that a file imports, at the top or inside a function, by its full name."""
    path = FILES[module]
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package) if node.level else node.module
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def within(module, *packages):
    return any(module == f"robodyn.{p}" or module.startswith(f"robodyn.{p}.") for p in packages)


# Each room, and those that its code may know, by whatever way: what these import counts as well.
ROOMS = {
    "errors": (),
    "system": ("errors",),
    "arithmetic": ("errors",),
    "joints": ("arithmetic",),
    "model": ("joints", "system"),
    "formalism": ("model",),
    "loads": ("formalism",),
    "checks": ("loads",),
    "dynamics": ("loads",),
    "engine.trace": ("arithmetic", "system"),
    "engine.emit": ("engine.trace",),
    "engine.run": ("engine.emit",),
    "evaluation": ("dynamics", "checks", "engine.run"),
    "scene": ("evaluation",),
    "urdf": ("model",),
    "robot": ("scene", "urdf"),
    "random": ("robot",),
    "view": ("model",),
    "simulation": ("robot", "view"),
    "report": ("simulation", "random"),
    "cli": ("report",),
}


def room(module):
    """The room that a module, or a name imported from it, belongs to; None for the package itself and for what is no part of it."""
    return next((name for name in ROOMS if within(module, name)), None)


def below(name):
    """The rooms that a room may know."""
    return set().union(*({other, *below(other)} for other in ROOMS[name]))


def reached(module):
    """The modules of the package that a module imports, and that those import, and so on."""
    found, todo = {}, [(module, ())]
    while todo:
        current, way = todo.pop()
        for name in imports(current):
            target = name if name in FILES else name.rpartition(".")[0]
            if target in FILES and target not in ("robodyn", module) and target not in found:
                found[target] = (*way, target)
                todo.append((target, found[target]))
    return found


def test_every_module_is_in_a_room():
    assert not [m for m in FILES if m != "robodyn" and m != "robodyn.engine" and room(m) is None]


@pytest.mark.parametrize("name", ROOMS)
def test_no_room_knows_those_above(name):
    """Followed through: what a room's imports import is known to it as well."""
    allowed = {name, *below(name)}
    found = {m: way for start in FILES if within(start, name) for m, way in reached(start).items() if room(m) not in allowed}
    assert not found


def test_no_circle_of_imports():
    """No module leads back to itself, whichever way, imports inside functions and for type checkers alone included.

    The packages that a module lies in are no way: they are there before it, and show what is in them.
    """
    found = {m: {n if n in FILES else n.rpartition(".")[0] for n in imports(m)} & set(FILES) for m in FILES}
    direct = {m: {n for n in needs if not f"{m}.".startswith(f"{n}.")} for m, needs in found.items()}
    order, left = [], dict(direct)
    while ready := [m for m, needs in left.items() if not needs & set(left)]:
        order += ready
        left = {m: needs for m, needs in left.items() if m not in ready}
    assert not left, f"in circles: {sorted(left)}"


@pytest.mark.parametrize(
    ("library", "users"),
    [
        ("yourdfpy", ("urdf", "view")),
        ("trimesh", ("urdf", "view")),
        ("meshcat", ("urdf", "view")),
        ("lxml", ("urdf",)),
        ("llvmlite", ("engine",)),
        ("matplotlib", ("simulation",)),
        ("pinocchio", ("report.peers",)),
        ("mujoco", ("report.peers",)),
    ],
)
def test_libraries_stay_where_they_belong(library, users):
    found = {m for m in FILES for i in imports(m) if i.partition(".")[0] == library and not within(m, *users)}
    assert not found


# --- documentation -----------------------------------------------------------------------------------------------------


SUBCOMMANDS = {f"{module.__name__}.{function}" for module in COMMANDS.values() for function in ("arguments", "run")}


def public(module):
    """What a module defines without a leading underscore: functions, classes and their methods, each with its docstring.

    An overriding method has that of the one it overrides; what @dataclass makes up for a class is none. The two functions
    that every subcommand consists of explain themselves.
    """
    m = importlib.import_module(module)
    for name, value in vars(m).items():
        path = f"{module}.{name}"
        if name.startswith("_") or getattr(value, "__module__", None) != module or path in SUBCOMMANDS:
            continue
        if inspect.isfunction(value):
            yield path, value.__doc__
        elif inspect.isclass(value):
            made_up = (value.__doc__ or "").startswith(f"{name}(")
            yield path, None if made_up else value.__doc__
            own = {k: x for k, x in vars(value).items() if not k.startswith("_")}
            methods = (
                k for k, x in own.items() if inspect.isroutine(x) or isinstance(x, (property, classmethod, functools.cached_property))
            )
            yield from ((f"{path}.{k}", inspect.getdoc(getattr(value, k))) for k in methods)


@pytest.mark.parametrize("module", MODULES)
def test_what_is_public_has_a_docstring(module):
    assert importlib.import_module(module).__doc__
    assert not [path for path, doc in public(module) if not doc]


ERRORS = {name for name, x in vars(errors).items() if inspect.isclass(x) and issubclass(x, rd.RobodynError)}


def raised(function):
    """The errors of the package that a function raises itself: not one that it calls, nor one defined in it."""
    todo, found = list(function.body), set()
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            found.add(ast.unparse(node.exc.func).rpartition(".")[2])
        if not isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Lambda):
            todo += ast.iter_child_nodes(node)
    return found & ERRORS


def unnamed_errors(module):
    """Public functions and methods with an error that they raise and their docstrings do not name.

    The class's docstring speaks for what makes or checks an object, and for operators.
    """
    tree = ast.parse(FILES[module].read_text("utf-8"))
    for owner in (tree, *(node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_"))):
        for node in owner.body:
            if not isinstance(node, ast.FunctionDef) or f"{module}.{node.name}" in SUBCOMMANDS:
                continue
            operator = node.name.startswith("__") and node.name.endswith("__")
            if node.name.startswith("_") and not operator:
                continue
            said = ast.get_docstring(node) or ""
            if owner is not tree and (operator or node.name == "check"):
                said += ast.get_docstring(owner) or ""
            yield from (f"{getattr(owner, 'name', module)}.{node.name}: {error}" for error in raised(node) if error not in said)


@pytest.mark.parametrize("module", MODULES)
def test_what_raises_says_so(module):
    assert not list(unnamed_errors(module))


def test_a_robot_is_built_by_hand_as_its_docstring_says():
    """The example as it stands: a pendulum, θ̈ = −m g l sin θ / (Θ + m l²)."""
    lines = inspect.getdoc(rd.Robot).splitlines()
    example = {"rd": rd, "np": np}
    exec(textwrap.dedent("\n".join(line for line in lines if line.startswith("    "))), example)
    robot, theta = example["robot"], np.linspace(-3.0, 3.0, 7)
    m, l, moment = 2.0, 0.5, 0.01
    expected = -m * 9.81 * l * np.sin(theta) / (moment + m * l**2)
    for backend in ("native", "numpy"):
        found = robot.forward_dynamics(theta[:, None], np.zeros((7, 1)), backend=backend)[:, 0]
        assert np.allclose(found, expected, rtol=0, atol=16 * EPS * abs(expected).max())


def test_the_version_is_one():
    from importlib.metadata import version

    assert version("robodyn") == rd.__version__


def test_loads_and_control_laws_need_no_package_of_an_extra():
    """The README's first script and the control laws, in a process where mpmath, Pinocchio, MuJoCo and Matplotlib cannot be imported."""
    code = """
import sys
sys.modules.update(dict.fromkeys(("mpmath", "pinocchio", "mujoco", "matplotlib")))
import numpy as np, robodyn as rd
robot = rd.random_robot(np.random.default_rng(0), 3, joint_types=("revolute",))
law = lambda t, q, v: np.where(q > 0, -np.tanh(q), -2.0 * v)
loads = [rd.LinkWrench("link_3", force=(0, 0, -50)), rd.ControlLaw(law), rd.Sampled(lambda t, q, v: -q, 1e-2)]
for backend in ("native", "numpy"):
    trajectory = rd.simulate(rd.Scene(robot, loads=loads), t_end=0.05, backend=backend)
    assert np.isfinite(trajectory.reactions().array).all() and trajectory.completed
print("fine")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "fine", done.stderr


@pytest.mark.parametrize("arguments", [["ur5e.urdf"], ["--chains", "3"]])
def test_the_benchmark_without_its_extra_says_which_one(arguments):
    """Not mpmath's own extra, which would bring no peers; and in a line, before anything is measured."""
    robots = Path(__file__).parents[1] / "robots"
    arguments = [str(robots / x) if x.endswith(".urdf") else x for x in arguments]
    code = f"""
import sys
sys.modules.update(dict.fromkeys(("mpmath", "pinocchio", "mujoco")))
from robodyn.cli import main
sys.exit(main(["bench", "--quick", *{arguments!r}]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "pip install 'robodyn[bench]'" in done.stderr
    assert "robodyn[mpmath]" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
