"""Errors. Each class has the exit code with which the programs end for the same reason, so that scripts can use it."""


class GraspmillError(Exception):
    """Base of all errors of this package."""

    #: The exit code with which the programs end for the same reason.
    exit_code: int = 1


class InternalError(GraspmillError):
    """A defect of graspmill; please report it."""


class InputError(GraspmillError, ValueError):
    """An argument, a setting or a path is wrong; the message names it, the rule and the value."""

    exit_code = 78


class DataError(GraspmillError):
    """Data are damaged, have an unknown version, or differ when made again: do not retry."""

    exit_code = 65


class IncompleteError(GraspmillError):
    """The dataset is not complete: generate the missing shards."""

    exit_code = 69


class OutsideError(GraspmillError, OSError):
    """Disk, memory or an object store failed: try again."""

    exit_code = 75
