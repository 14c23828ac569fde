"""robodyn: load a URDF, simulate it, know what force every joint carries.

    import robodyn as rd

    robot = rd.load("robots/ur5e.urdf")
    trajectory = rd.simulate(rd.Scene(robot), t_end=5.0)
    trajectory.to_html("run.html")

SI units and radians; six-vectors angular first; quaternions (w, x, y, z). Conventions: README.md.
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

# name → the module that defines it; imported when first asked for, so that `import robodyn` costs next to nothing.
_PUBLIC = {
    "load": "robot",
    "Robot": "robot",
    "random_robot": "random",
    "Scene": "scene",
    "Reactions": "formalism.reactions",
    "simulate": "simulation",
    "simulate_many": "simulation",
    "Trajectory": "simulation",
    "Trajectories": "simulation",
    "loads": "loads",
    "joints": "joints",
    **dict.fromkeys(("Inertia", "Joint", "Limits", "Link", "Mimic"), "model"),
    **dict.fromkeys(("ControlLaw", "JointDamping", "JointForce", "JointFriction", "JointSpring", "LinkWrench", "Sampled"), "loads"),
    **dict.fromkeys(
        ("RobodynError", "UrdfError", "ModelError", "InputError", "SimulationError", "FileError", "MissingPackageError", "RobodynWarning"),
        "errors",
    ),
}

__all__ = ["__version__", *_PUBLIC]  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from . import joints, loads
    from .errors import FileError, InputError, MissingPackageError, ModelError, RobodynError, RobodynWarning, SimulationError, UrdfError
    from .formalism.reactions import Reactions
    from .loads import ControlLaw, JointDamping, JointForce, JointFriction, JointSpring, LinkWrench, Sampled
    from .model import Inertia, Joint, Limits, Link, Mimic
    from .random import random_robot
    from .robot import Robot, load
    from .scene import Scene
    from .simulation import Trajectories, Trajectory, simulate, simulate_many


def __getattr__(name: str) -> object:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'robodyn' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(f"{__name__}.{_PUBLIC[name]}")
    value = module if name == _PUBLIC[name] else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__") and name != "__version__")])
