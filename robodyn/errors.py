"""The exceptions of robodyn: one family, so that one `except robodyn.RobodynError` catches a user's mistake.

Every message names the object, the condition, the number and the remedy.
"""


class RobodynError(Exception):
    """Root of every error that robodyn raises on purpose."""


class UrdfError(RobodynError):
    """A robot file that cannot be read, or that says something a robot cannot be."""


class ModelError(RobodynError):
    """A robot whose motion or forces are undetermined, or a name the robot does not have."""


class UnknownNameError(ModelError, KeyError):
    """A name that the robot, or a result, does not have."""

    __str__ = Exception.__str__  # KeyError would quote the message


class InputError(RobodynError, ValueError):
    """An argument of the wrong shape, type or value."""


class SimulationError(RobodynError):
    """A simulation that cannot go on: the step size went to zero, a state stopped being finite.

    `trajectory` holds what had been computed, where there is any.
    """

    trajectory = None


class FileError(RobodynError):
    """A file of robodyn's own that cannot be read or written."""


class MissingPackageError(RobodynError, ImportError):
    """An optional package is not installed; the message says which extra brings it."""


class RobodynWarning(UserWarning):
    """Something was ignored or assumed; the message says what and why."""
