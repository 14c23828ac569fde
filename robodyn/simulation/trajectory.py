"""`Trajectory`: the motion of a scene at a sequence of times, and what can be made of it."""

import io
import json
import os
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arithmetic import Array
from ..dynamics.questions import Energies, LinkPoses, Result
from ..dynamics.state_vector import Parts
from ..errors import FileError, InputError, MissingPackageError, RobodynWarning
from ..formalism.reactions import Reactions
from ..loads import ControlLaw, Sampled
from ..scene import Scene
from ..system.files import atomic_write, make_folder, writable
from .quantities import QUANTITIES, described, recorded
from .storage import from_json, to_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMAT = 1  # of the npz file


class Energy(NamedTuple):
    """Energies (T,) [J] over time, against the ground. `balance` would be constant if the integration were exact."""

    kinetic: Array  # (T,) [J]
    potential: Array  # (T,) [J]: gravity and springs
    work: Array  # (T,) [J]: what all other loads have put in since the start; damping takes out, so it is negative
    balance: Array  # (T,) [J]: kinetic + potential − work

    @property
    def drift(self) -> float:
        """The largest |balance − balance at the start| [J]."""
        return float(abs(self.balance - self.balance[0]).max()) if len(self.balance) else 0.0


@dataclass(frozen=True, eq=False)
class Trajectory:
    __doc__ = f"""The motion of a scene at a sequence of times.

    {described(recorded())}
    stats: method, formalism, backend, rtol and atol or dt [s], steps, rejected, evaluations, wall_time [s], completed.
    """

    scene: Scene
    t: Array
    q: Array
    v: Array
    z: Array
    a: Array
    u: Array
    work: Array
    stats: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, scene: Scene, t: Array, states: Parts, tau: Array | None, formalism: str, backend: str, stats: dict[str, Any]
    ) -> "Trajectory":
        """That of states (T, …) at times t (T,) [s]; what else it holds is evaluated there, under held joint forces tau (T, nv) if any.

        ModelError where a state determines no acceleration.
        """
        now = {"q": states.q, "v": states.v, "tau": tau, "z": states.z}
        result = scene.evaluator.ask(Result(formalism), backend, t=t, **now)
        return cls(scene=scene, stats=stats, **{x.name: x.found(t, states, result) for x in recorded()})

    @property
    def completed(self) -> bool:
        """Whether the simulation reached its end; not so after Ctrl-C or an error."""
        return bool(self.stats.get("completed", True))

    def reactions(self, *, frame: str = "child", part: str = "constraint", joints: Iterable[str] | None = None) -> Reactions:
        """The wrench (T, 6) [N m, N] of every joint over time; see `Scene.reactions` for frames and parts.

        InputError where frame or part is none of them; ModelError where there is no joint of a name.
        """
        options = {"frame": frame, "part": part, "joints": joints, "z": self.z}
        return self.scene.reactions_of(self.q, self.v, self.a, self.u, t=self.t, **options)

    def energy(self) -> Energy:
        """Kinetic and potential energy, the work of the loads, and their balance."""
        got = self.scene.evaluator.ask(Energies(), t=self.t, q=self.q, v=self.v, z=self.z)
        return Energy(got["kinetic"], got["potential"], self.work, got["kinetic"] + got["potential"] - self.work)

    def link_poses(self) -> Array:
        """The pose (T, nlinks, 4, 4) [1, m] of every link in the ground's frame."""
        return self.scene.evaluator.ask(LinkPoses(), t=self.t, q=self.q)["poses"]

    # --- files ---

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to an .npz file: the states and the scene they belong to.

        A ControlLaw or Sampled is a function and cannot be stored: a warning says so, and its recorded forces are kept.
        FileError where the file cannot be written, or a load is none of robodyn's own.
        """
        writable(path)
        kept = tuple(load for load in self.scene.loads if not isinstance(load, (ControlLaw, Sampled)))
        for name in sorted({type(load).__name__ for load in self.scene.loads if load not in kept}):
            warnings.warn(f"a {name} cannot be stored: the file keeps its forces, not its function", RobodynWarning, stacklevel=2)
        buffer = io.BytesIO()
        try:
            scene, stats = to_json(replace(self.scene, loads=kept)), json.dumps(self.stats)
        except TypeError as error:
            raise FileError(f"cannot write {str(path)!r}: {error}") from error
        arrays: dict[str, Any] = {x.name: x.of(self) for x in recorded() if x.numbers(self.scene) or not x.optional}
        np.savez_compressed(buffer, format=FORMAT, scene=scene, stats=stats, **arrays)
        atomic_write(path, buffer.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Trajectory":
        """Read what `save` wrote. FileError where the file is missing, damaged or not a trajectory."""
        try:
            with np.load(path, allow_pickle=False) as file:
                if int(file["format"]) > FORMAT:
                    raise FileError(f"{os.fspath(path)!r} was written by a newer robodyn (format {int(file['format'])}): update robodyn")
                arrays = {x.name: file[x.name] for x in recorded() if x.name in file or not x.optional}
                scene, stats = from_json(str(file["scene"])), json.loads(str(file["stats"]))
                if not isinstance(scene, Scene) or not isinstance(stats, dict):
                    raise FileError("it holds no scene")
        except FileNotFoundError:
            raise FileError(f"there is no file {os.fspath(path)!r}") from None
        except Exception as error:  # whatever NumPy's reader trips over in a file that is damaged or made to harm
            raise FileError(f"{os.fspath(path)!r} is not a trajectory of robodyn, or is damaged: {error}") from error
        n = arrays["t"].size
        arrays = {x.name: np.zeros((n, *x.shape_in(scene))) for x in recorded() if x.optional and not x.numbers(scene)} | arrays
        wrong = [x.name for x in recorded() if x.name not in arrays or not x.fits(arrays[x.name], n, scene)]
        if wrong:
            raise FileError(f"{os.fspath(path)!r} is damaged: {', '.join(wrong)} are not the numbers that its robot needs")
        return cls(scene=scene, stats=stats, **arrays)

    def to_csv(self, folder: str | os.PathLike[str]) -> None:
        """Write states.csv, reactions.csv and energy.csv: named columns with units, every digit of the numbers.

        FileError where they cannot be written.
        """
        folder = make_folder(folder)
        for table in dict.fromkeys(x.csv for x in QUANTITIES.values() if x.csv):
            shown = [x for x in QUANTITIES.values() if x.csv == table]
            columns = [label for x in shown for label in x.labels(self.scene)]
            self._csv(folder / f"{table}.csv", columns, np.hstack([x.rows(self) for x in shown]))

    def _csv(self, path: Path, columns: list[tuple[str, str]], rows: Array) -> None:
        import csv

        text = io.StringIO(newline="")
        header = ["t [s]", *(f"{name} [{unit}]" for name, unit in columns)]
        # Quotes only where they are needed; a carriage return is what `csv` forgets.
        csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL if "\r" in "".join(header) else csv.QUOTE_MINIMAL).writerow(header)
        csv.writer(text, lineterminator="\n").writerows(np.column_stack([self.t, rows]).tolist())
        atomic_write(path, text.getvalue())

    def to_html(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write a page that shows the motion in any browser, with no server and no network; options of `view.write_html`.

        FileError where it cannot be written.
        """
        from ..view import write_html

        write_html(path, self.scene.robot, times=self.t, poses=self.link_poses(), **options)

    def plot(self, joints: Iterable[str] | None = None) -> "Figure":
        """A Matplotlib figure: positions, velocities, and the reaction's force and moment of the named joints (all moving ones).

        MissingPackageError without Matplotlib, ModelError where there is no joint of a name, InputError where none is named.
        """
        try:
            from matplotlib.figure import Figure
        except ImportError as error:
            raise MissingPackageError("Trajectory.plot needs Matplotlib: pip install 'robodyn[plot]'") from error
        robot = self.scene.robot
        names = list(robot.joint_names if joints is None else [joints] if isinstance(joints, str) else joints)
        if not names:
            raise InputError("there is no joint to plot")
        q_names, v_names = robot.coordinate_names()
        reactions = self.reactions(joints=names)
        figure = Figure(figsize=(9, 10), layout="constrained")
        panels = figure.subplots(4, 1, sharex=True)
        for name in names:
            i = robot.joint_index(name)
            for panel, values, where, labels in (
                (panels[0], self.q, robot.q_slices[i], q_names),
                (panels[1], self.v, robot.v_slices[i], v_names),
            ):
                for column in range(where.start, where.stop):
                    panel.plot(self.t, values[:, column], label="{} [{}]".format(*labels[column]))
            panels[2].plot(self.t, np.linalg.norm(reactions[name][:, 3:], axis=-1), label=name)
            panels[3].plot(self.t, np.linalg.norm(reactions[name][:, :3], axis=-1), label=name)
        titles = ("position", "velocity", "reaction force [N]", "reaction moment [N m]")
        for panel, title in zip(panels, titles, strict=True):
            panel.set_ylabel(title)
            panel.grid(alpha=0.3)
            if panel.lines:
                panel.legend(fontsize="x-small", loc="upper right", ncols=2)
        panels[-1].set_xlabel("t [s]")
        return figure

    def __repr__(self) -> str:
        span = f"{self.t[0]:g} to {self.t[-1]:g} s" if len(self.t) else "empty"
        return f"<Trajectory of {self.scene.robot.name!r}: {len(self.t)} states, {span}{'' if self.completed else ', interrupted'}>"
