"""The `robodyn` command: what it prints and writes, its exit codes, and that no mistake of a user ends in a traceback."""

import csv
import importlib.metadata
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import robodyn as rd
from robodyn.cli import COMMANDS, main

ROBOTS = Path(__file__).parents[1] / "robots"
FILES = sorted(path.stem for path in ROBOTS.glob("*.urdf"))
PENDULUM = str(ROBOTS / "pendulum.urdf")
COMMAND = "import sys; from robodyn.cli import main; sys.exit(main())"


@pytest.fixture(autouse=True)
def warnings_as_before():
    """`main` decides how warnings are shown, as a program may; the test's own process goes on as it was."""
    with warnings.catch_warnings():
        yield


@pytest.fixture
def robodyn(capsys, monkeypatch, tmp_path):
    """Run the command in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        try:
            code = main([str(a) for a in arguments])
        except SystemExit as exit:
            code = exit.code
        out, err = capsys.readouterr()
        return code, out, err

    return run


# A fixed joint that is said to mimic another: read, with a warning.
SUSPICIOUS = """<robot name="w"><link name="a"/><link name="b"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="c"/>
  <joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>
  <joint name="weld" type="fixed"><parent link="b"/><child link="c"/><mimic joint="j"/></joint></robot>"""


def robot_file(name):
    return ROBOTS / f"{name}.urdf"


# --- info, check -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", FILES)
def test_info(file, robodyn):
    """Every link and joint by its full name, the coordinates' numbers, the mass."""
    code, out, err = robodyn("info", robot_file(file))
    robot = rd.load(robot_file(file))
    assert (code, err) == (0, "")
    mass = sum(link.inertia.mass for link in robot.links)
    first = f"{robot.name}: {len(robot.links)} links, {len(robot.joints)} joints, nq={robot.nq}, nv={robot.nv}, mass {mass:.6g} kg"
    assert out.startswith(first)
    joints, links = out.split("\n\n")[1:3]
    assert [line.split()[0] for line in joints.splitlines()[2:]] == list(robot.all_joint_names)
    assert [line.split()[0] for line in links.splitlines()[2:]] == list(robot.link_names)
    assert "\x1b" not in out


def test_info_says_where_each_joints_numbers_stand(robodyn):
    out = robodyn("info", robot_file("quadruped"), "--floating-base")[1]
    rows = {line.split()[0]: line for line in out.splitlines() if line}
    assert re.search(r"floating +\(ground\) +\S+ +0…6 +0…5\b", rows["ground"])
    assert "nq=19, nv=18" in out
    out = robodyn("info", robot_file("panda"))[1]
    assert re.search(r"mimics \S+ × 1 \+ 0", out)


def test_info_shows_the_inertia_about_the_centre_of_mass(robodyn, tmp_path):
    (tmp_path / "r.urdf").write_text(
        """<robot name="r"><link name="a"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
        <inertia ixx="1" iyy="2.5" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
    )
    row = robodyn("info", "r.urdf")[1].splitlines()[-1]
    assert row.split() == ["a", "2", "0.5", "0", "0", "1", "2", "2.5"]


@pytest.mark.parametrize("file", FILES)
def test_check(file, robodyn):
    """All robots of the repository can be simulated; the ledger says what became of every tag."""
    code, out, err = robodyn("check", robot_file(file))
    robot = rd.load(robot_file(file))
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == f"{robot.name}: no error, 0 warnings; nq={robot.nq}, nv={robot.nv}, its motion is determined"
    for element, verdict, _ in robot.ledger:
        assert re.search(re.escape(element) + r" +" + verdict, out), element


def test_check_refuses_what_cannot_move(robodyn, tmp_path):
    (tmp_path / "light.urdf").write_text(
        """<robot name="light"><link name="a"/><link name="b"/>
        <joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""
    )
    code, out, err = robodyn("check", "light.urdf")
    assert code == 1
    assert "error" in err
    assert "'j'" in err
    assert "determined" not in out.splitlines()[-1]


def test_check_prints_warnings_and_counts_them(robodyn, tmp_path):
    (tmp_path / "w.urdf").write_text(SUSPICIOUS)
    code, out, _ = robodyn("check", "w.urdf")
    told = [line for line in out.splitlines() if line.startswith("warning: ")]
    assert code == 0
    assert "no error, 1 warning;" in out
    assert len(told) == 1
    assert "mimic" in told[0]


def test_check_names_every_problem(robodyn, tmp_path):
    (tmp_path / "bad.urdf").write_text('<robot name="bad"><link name="a"/><link name="a"/><joint name="j" type="hinge"/></robot>')
    code, _, err = robodyn("check", "bad.urdf")
    assert code == 1
    assert "bad.urdf" in err
    assert "'a'" in err
    assert "hinge" in err


# --- simulate ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", FILES)
def test_simulate(file, robodyn):
    """A short run of every robot: a line on the method, the energy, and the largest reaction of every joint."""
    code, out, err = robodyn("simulate", robot_file(file), "--t-end", "0.01", "--quiet", "--method", "rk4", "--dt", "0.005")
    robot = rd.load(robot_file(file))
    assert (code, err) == (0, "")
    assert out.startswith(f"{robot.name}: 0 to 0.01 s by rk4, dt 0.005 s\n  2 steps, 9 evaluations")
    assert [line.split()[0] for line in out.split("\n\n")[1].splitlines()[2:]] == list(robot.all_joint_names)


def test_simulate_writes_what_python_would(robodyn, tmp_path):
    arguments = ["--t-end", "0.05", "--q0", "qA=1.2", "--v0", "qB=-0.5", "--gravity", "0", "0.5", "-3", "--rtol", "1e-8", "--fps", "100"]
    outputs = ["--npz", "run.npz", "--csv", "tables", "--html", "run.html"]
    code, out, _ = robodyn("simulate", robot_file("double_pendulum"), *arguments, *outputs, "--quiet")
    assert code == 0
    assert all(f"wrote {name}" in out for name in ("run.npz", "tables", "run.html"))
    robot = rd.load(robot_file("double_pendulum"))
    expected = rd.simulate(rd.Scene(robot, gravity=(0, 0.5, -3)), t_end=0.05, q0=[1.2, 0], v0=[0, -0.5], rtol=1e-8, fps=100)
    found = rd.Trajectory.load(tmp_path / "run.npz")
    assert np.array_equal(found.q, expected.q)
    assert np.array_equal(found.t, expected.t)
    with open(tmp_path / "tables" / "states.csv", newline="", encoding="utf-8") as file:
        assert len(list(csv.reader(file))) == 1 + len(expected.t)
    assert (tmp_path / "run.html").read_text("utf-8").startswith("<!")
    largest = np.linalg.norm(expected.reactions()["qB"][:, 3:], axis=-1).max()
    assert re.search(rf"^qB +{largest:.4g} ", out, re.MULTILINE)


def test_simulate_counts_what_damping_took(robodyn):
    code, out, _ = robodyn("simulate", robot_file("ur5e"), "--t-end", "0.05", "--v0", "elbow_joint=2", "--quiet")
    assert code == 0
    took = float(re.search(r"the loads took out (\S+) J", out)[1])
    robot = rd.load(robot_file("ur5e"))
    v0 = np.zeros(6)
    v0[robot.joint_names.index("elbow_joint")] = 2.0
    assert took == pytest.approx(-rd.simulate(robot, t_end=0.05, v0=v0).work[-1], rel=1e-3)
    assert took > 0


def test_simulate_a_floating_base_and_locked_joints(robodyn, tmp_path):
    arguments = ["--floating-base", "--q0", "ground.z=0.6", "--v0", "ground.vx=1", "--t-end", "0.01", "--method", "rk4", "--dt", "0.01"]
    robot = rd.load(robot_file("quadruped"), floating_base=True)
    lock = robot.joint_names[1]
    code, _, err = robodyn("simulate", robot_file("quadruped"), *arguments, "--lock", f"{lock}=0.3", "--npz", "run", "--quiet")
    assert (code, err) == (0, "")
    run = rd.Trajectory.load(tmp_path / "run")
    assert run.q[0, :7].tolist() == [0, 0, 0.6, 1, 0, 0, 0]
    assert run.v[0, 3] == 1
    assert lock not in run.scene.robot.joint_names
    assert run.q.shape[1] == robot.nq - 1


def test_a_quaternion_that_was_left_unnormalised(robodyn):
    code, _, err = robodyn("simulate", robot_file("quadruped"), "--floating-base", "--q0", "ground.qx=1", "--t-end", "0.01", "--quiet")
    assert code == 1
    assert "'ground' has the length 1.41421356" in err


def test_a_simulation_that_fails_writes_what_it_has(robodyn, tmp_path, monkeypatch):
    """Exit code 1 and the reason; the files hold the states up to there."""
    import robodyn.cli.simulate as command

    def failing(scene, **options):
        law = rd.ControlLaw(lambda t, q, v: np.full(1, np.nan if t > 0.05 else 0.0))
        return rd.simulate(rd.Scene(scene.robot, loads=[law]), **{**options, "method": "rk4", "dt": 0.01, "fps": None, "backend": "numpy"})

    monkeypatch.setattr(command, "simulate", failing)
    code, out, err = robodyn("simulate", PENDULUM, "--t-end", "1", "--quiet", "--csv", "tables")
    assert code == 1
    assert err.startswith("robodyn: error: at t=0.0")
    assert "wrote tables" in out
    assert (tmp_path / "tables" / "states.csv").exists()


def test_the_results_are_not_mixed_with_the_progress(robodyn):
    out = robodyn("simulate", PENDULUM, "--t-end", "0.01")[1]
    assert out.startswith("pendulum: 0 to 0.01 s")


# --- view --------------------------------------------------------------------------------------------------------------


def test_view_a_robot_and_a_run(robodyn, tmp_path):
    assert robodyn("view", PENDULUM) == (0, "wrote pendulum.html\n", "")
    rd.simulate(rd.load(PENDULUM), t_end=0.05).save(tmp_path / "run.npz")
    assert robodyn("view", "run.npz", "-o", "other.html") == (0, "wrote other.html\n", "")
    assert (tmp_path / "pendulum.html").stat().st_size > 1e5
    assert (tmp_path / "other.html").stat().st_size > 1e5


def test_view_opens_the_page(robodyn, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert robodyn("view", PENDULUM, "--open")[0] == 0
    assert opened == [(tmp_path / "pendulum.html").as_uri()]


# --- help --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help(command, robodyn):
    code, out, err = robodyn(*filter(None, [command]), "--help")
    assert (code, err) == (0, "")
    assert out.startswith(f"usage: robodyn {command or ''}".rstrip())
    if command is None:
        assert all(re.search(rf"^ +{name} ", out, re.MULTILINE) for name in COMMANDS)
        assert "examples:" in out
    else:
        assert len(out.splitlines()) > 6


def test_version(robodyn):
    assert robodyn("--version") == (0, f"robodyn {rd.__version__}\n", "")


@pytest.mark.parametrize("line", re.findall(r"^  robodyn (.*)$", __import__("robodyn.cli").cli.EPILOG, re.MULTILINE))
def test_the_examples_of_the_help_are_commands(line, robodyn):
    """They parse; the options are real."""
    from robodyn.cli import parser

    assert parser().parse_args(line.split()).command in COMMANDS


def test_the_command_is_installed():
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name="robodyn")
    assert entry.load() is main


# --- mistakes ----------------------------------------------------------------------------------------------------------

SIMULATE = ["simulate", PENDULUM, "--t-end", "0.01", "--quiet"]


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["info"],
        ["simulate"],
        ["simulate", PENDULUM],
        ["simulate", PENDULUM, "--t-end", "soon"],
        [*SIMULATE, "--method", "euler"],
        [*SIMULATE, "--rtol", "tight"],
        [*SIMULATE, "--gravity", "9.81"],
        [*SIMULATE, "--gravity", "0", "0", "down"],
        [*SIMULATE, "--surprise"],
        ["info", PENDULUM, "more"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_2(arguments, robodyn):
    code, out, err = robodyn(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("usage: robodyn")
    assert "error:" in err.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["info", "none.urdf"], "none.urdf"),
        (["check", "none.urdf"], "none.urdf"),
        (["simulate", "none.urdf", "--t-end", "1"], "none.urdf"),
        (["view", "none.urdf"], "none.urdf"),
        (["view", "none.npz"], "no file 'none.npz'"),
        (["info", "."], "cannot be read"),
        (["info", ""], "cannot be read"),
        (["info", "nul\0byte"], "cannot be read"),
        (["info", "<robot/>"], "StringIO"),
        ([*SIMULATE, "--lock", "hing=1"], "no joint named 'hing'|'hing'"),
        ([*SIMULATE, "--lock", "hinge"], "--lock 'hinge' is not of the form NAME=NUMBER"),
        ([*SIMULATE, "--q0", "nothing=1"], "--q0 nothing=1: there is no coordinate of that name; there are"),
        ([*SIMULATE, "--v0", "=1"], "--v0 '=1' is not of the form"),
        ([*SIMULATE, "--v0", "nothing"], "--v0 'nothing' is not of the form"),
        ([*SIMULATE, "--q0", "HINGE=far"], "is not of the form"),
        ([*SIMULATE, "--q0", "HINGE=nan"], r"q0\[0\] .* is nan"),
        ([*SIMULATE, "--v0", "HINGE=inf"], r"v0\[0\] .* is inf"),
        ([*SIMULATE, "--gravity", "0", "0", "nan"], "gravity"),
        (["simulate", PENDULUM, "--t-end", "-1"], "t_end=-1.0 must be later"),
        (["simulate", PENDULUM, "--t-end", "0"], "t_end=0.0 must be later"),
        (["simulate", PENDULUM, "--t-end", "nan"], "t_end=nan must be finite"),
        (["simulate", PENDULUM, "--t-end", "1e300", "--quiet"], "t_end|fps"),
        ([*SIMULATE, "--rtol", "1e-20"], "rtol=1e-20"),
        ([*SIMULATE, "--dt", "0"], "dt=0"),
        ([*SIMULATE, "--fps", "0"], "fps=0.0 must be positive"),
        ([*SIMULATE, "--fps", "1e300"], "fps"),
        ([*SIMULATE, "--npz", "none/run.npz"], "cannot write 'none/run.npz'"),
        ([*SIMULATE, "--html", "none/run.html"], "cannot write 'none/run.html'"),
        ([*SIMULATE, "--npz", "."], "cannot write '.'"),
        ([*SIMULATE, "--npz", ""], "cannot write"),
        ([*SIMULATE, "--csv", PENDULUM], "cannot make the folder"),
        (["view", PENDULUM, "-o", "none/page.html"], "cannot write 'none/page.html'"),
        (["view", "broken.npz"], "'broken.npz' is not a trajectory"),
        (["info", "broken.npz"], "broken.npz"),
    ],
    ids=lambda x: " ".join(x).replace(PENDULUM, "ROBOT").replace("\0", "NUL") if isinstance(x, list) else "",
)
def test_a_users_mistake_is_1_with_a_reason(arguments, message, robodyn, tmp_path):
    """One line on standard error that names what is wrong; what an exception would print is not for users."""
    (tmp_path / "broken.npz").write_bytes(b"PK nonsense")
    joint = rd.load(PENDULUM).joint_names[0]
    code, _, err = robodyn(*(a.replace("HINGE", joint) for a in arguments))
    assert code == 1
    assert err.startswith("robodyn: error: ")
    assert re.search(message, err)
    assert "Traceback" not in err


def test_outputs_that_cannot_be_written_are_known_before_the_run(robodyn, monkeypatch):
    """An hour of computing must not end in a folder that was never there."""
    import robodyn.cli.simulate as command

    called = []
    monkeypatch.setattr(command, "simulate", lambda *a, **o: called.append(1) or rd.simulate(*a, **o))
    code, _, err = robodyn(*SIMULATE, "--npz", "none/run.npz")
    assert code == 1
    assert "none" in err
    assert not called


def test_warnings_are_one_line_each(robodyn, tmp_path):
    (tmp_path / "w.urdf").write_text(SUSPICIOUS)
    code, _, err = robodyn("info", "w.urdf")
    assert code == 0
    assert err
    assert all(line.startswith("robodyn: warning: ") for line in err.splitlines())
    assert "mimic" in err


def test_interrupted_while_loading(robodyn, monkeypatch):
    import robodyn.cli.info as command

    def interrupt(options):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "load_robot", interrupt)
    assert robodyn("info", PENDULUM) == (130, "", "robodyn: interrupted\n")


# --- names and widths --------------------------------------------------------------------------------------------------

LONG = "a_joint_with_a_name_that_tells_the_whole_story_of_the_robot_and_of_the_company_that_made_it"


def long_robot(path, joint=LONG):
    links = [f"{LONG.replace('joint', 'link')}_{i}" for i in range(2)]
    path.write_text(
        f"""<robot name="long"><link name="{links[0]}"/><link name="{links[1]}"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="{joint}" type="continuous"><parent link="{links[0]}"/><child link="{links[1]}"/></joint></robot>"""
    )
    return links


@pytest.mark.parametrize("columns", ["40", "80", "300", None])
@pytest.mark.parametrize("command", [["info"], ["simulate", "--t-end", "0.01", "--quiet"]], ids=lambda c: c[0])
def test_a_file_or_pipe_gets_whole_names(command, columns, robodyn, tmp_path, monkeypatch):
    """Whatever the terminal's width: `robodyn info robot.urdf | grep name` must find it."""
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    links = long_robot(tmp_path / "long.urdf")
    code, out, _ = robodyn(command[0], "long.urdf", *command[1:])
    assert code == 0
    row = next(line for line in out.splitlines() if LONG in line)
    if command[0] == "info":
        assert re.search(rf"{LONG} +continuous +{links[0]} +{links[1]} ", row)


@pytest.mark.parametrize("name", ["[bold]loud[/bold]", "[/]", ":smile:", "a b", "100%", "{x}", "关节", "[link=file:///etc]x[/link]"])
def test_names_are_text_not_markup(name, robodyn, tmp_path):
    long_robot(tmp_path / "r.urdf", name)
    for arguments in (["info", "r.urdf"], ["simulate", "r.urdf", "--t-end", "0.01", "--quiet"]):
        code, out, _ = robodyn(*arguments)
        assert code == 0
        assert name in out


# --- as its own process ------------------------------------------------------------------------------------------------


def process(*arguments, **options):
    options = {"capture_output": True, "text": True, "encoding": "utf-8", "timeout": 60, **options}
    environment = {**os.environ, **options.pop("env", {})}
    return subprocess.run([sys.executable, "-c", COMMAND, *map(str, arguments)], env=environment, check=False, **options)


def test_as_a_process(tmp_path):
    done = process(*SIMULATE, "--npz", "run.npz", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "largest reaction" in done.stdout
    assert rd.Trajectory.load(tmp_path / "run.npz").completed
    failed = process("info", "none.urdf", cwd=tmp_path)
    assert (failed.returncode, failed.stdout) == (1, "")
    assert failed.stderr.startswith("robodyn: error: none.urdf")
    assert len(failed.stderr.splitlines()) == 1


def test_colours_stay_out_of_a_pipe(tmp_path):
    for env in ({"NO_COLOR": "1"}, {"TERM": "dumb"}, {"TERM": "xterm-256color"}):
        done = process("info", ROBOTS / "ur5e.urdf", env=env)
        assert done.returncode == 0
        assert "\x1b" not in done.stdout + done.stderr


def test_an_output_that_knows_ascii_alone():
    """A minimal container, a Windows pipe: characters it does not have are replaced, nothing is lost but them."""
    for command in (["info"], ["check"]):
        done = process(*command, ROBOTS / "panda.urdf", env={"PYTHONIOENCODING": "ascii"})
        assert done.returncode == 0, done.stderr[-300:]
        assert "Traceback" not in done.stderr
        assert "panda" in done.stdout


def closed_early(*arguments, cwd=None, lines=1):
    """The command's code and errors when its reader goes away after a few lines, as `| head -1` does."""
    with subprocess.Popen(
        [sys.executable, "-c", COMMAND, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=cwd
    ) as p:
        for _ in range(lines):
            p.stdout.readline()
        p.stdout.close()
        err = p.stderr.read().decode()
        return p.wait(timeout=60), err


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGPIPE there")
@pytest.mark.parametrize("command", ["info", "check"])
def test_a_pipe_closed_early(command):
    """Quiet; and not the exit code that says the robot is broken."""
    code, err = closed_early(command, ROBOTS / "humanoid.urdf", lines=0)
    assert err == ""
    assert code == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGPIPE there")
def test_a_pipe_closed_early_does_not_cost_the_files(tmp_path):
    """`robodyn simulate … --npz run.npz | head -1`: what was asked for is written all the same."""
    code, err = closed_early(*SIMULATE, "--npz", "run.npz", cwd=tmp_path, lines=0)
    assert (tmp_path / "run.npz").exists()
    assert err == ""
    assert code == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_an_output_that_is_full(tmp_path):
    with open("/dev/full", "w") as full:
        done = process("info", PENDULUM, stdout=full, stderr=subprocess.PIPE, capture_output=False)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "No space left" in done.stderr


def test_no_output_at_all(tmp_path):
    """Standard output closed, as a daemon's may be: the files are written."""
    program = "import os, sys; os.close(1); sys.stdout = None\n" + COMMAND
    run = [sys.executable, "-c", program, *SIMULATE, "--npz", "run.npz"]
    done = subprocess.run(run, capture_output=True, text=True, cwd=tmp_path, check=False, timeout=60)
    assert "Traceback" not in done.stderr
    assert done.returncode == 0
    assert (tmp_path / "run.npz").exists()
