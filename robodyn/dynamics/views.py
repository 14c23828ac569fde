"""The equations of a scene on the trees that a question needs: links on fixed joints lumped, or cut open to show what those carry."""

from collections.abc import Callable, Iterable, Sequence

from ..arithmetic import Array, exact, precision
from ..loads import Load
from ..model import Mechanism, Minimal, Tree, lump
from .equations import Equations


class Views:
    """A scene's equations in one arithmetic, made when first asked for.

    backend: "mpmath" has the robot's numbers in 50 digits. fewest: where operations count, what finds the lumped tree's minimal one for η̇,
    or None where there is none to be used.
    """

    def __init__(
        self,
        robot: Mechanism,
        gravity: Array,
        loads: Sequence[Load],
        backend: str,
        *,
        fewest: Callable[[Tree], Minimal | None] | None = None,
    ) -> None:
        self._robot, self._gravity, self._loads, self._backend, self._fewest = robot, gravity, loads, backend, fewest
        self._cut: dict[frozenset[int], Equations] = {}

    def opened_at(self, joints: Iterable[int]) -> Equations:
        """Cut open at these joints (by index) where they are fixed, so that their reactions appear; lumped elsewhere."""
        fixed = frozenset(i for i in joints if self._robot.joints[i].type.rigid)
        if fixed not in self._cut:
            with precision(self._backend):
                robot, gravity = (self._robot.exact(), exact(self._gravity)) if self._backend == "mpmath" else (self._robot, self._gravity)
                tree = lump(robot, cut=fixed)
            # Cut open or not, it moves alike.
            find = self._fewest
            fewest = None if find is None else (lambda: self.lumped.minimal) if fixed else (lambda: find(tree))
            self._cut[fixed] = Equations(self._robot, tree, gravity, self._loads, fewest)
        return self._cut[fixed]

    @property
    def lumped(self) -> Equations:
        """On the bodies that move; links on fixed joints are lumped."""
        return self.opened_at(())

    @property
    def placed(self) -> Equations:
        """Those that place links with the fewest operations."""
        return self.lumped

    @property
    def opened(self) -> Equations:
        """Cut open at every joint, fixed ones and the joint to ground included."""
        return self.opened_at(range(len(self._robot.joints)))
