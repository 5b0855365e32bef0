"""The program: ``graspmill plan …``, or ``python -m graspmill plan …``."""

import sys


def main() -> int:
    """Runs the command that the arguments name; returns its exit code."""
    from graspmill import _native

    return _native.run_program(["graspmill", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
