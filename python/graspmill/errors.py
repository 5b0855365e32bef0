"""What can go wrong.

Each class stands for an exit code of the programs, which is its ``exit_code``, so that a script can act as a scheduler does.
"""


class GraspmillError(Exception):
    """Base of all errors of this package."""

    #: The exit code with which the programs end for the same reason.
    exit_code: int = 1


class InternalError(GraspmillError):
    """A defect of graspmill; please report it."""

    exit_code = 1


class InputError(GraspmillError, ValueError):
    """An argument, a setting or a path is wrong; the message names it, the rule and the value."""

    exit_code = 78


class DataError(GraspmillError):
    """Data are damaged, of an unknown version, or came out differently: do not try again."""

    exit_code = 65


class IncompleteError(GraspmillError):
    """The dataset is not complete yet: make the missing shards."""

    exit_code = 69


class OutsideError(GraspmillError, OSError):
    """The outside world failed (disk full, no memory, a store that does not answer): try again."""

    exit_code = 75
