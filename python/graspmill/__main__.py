"""The program: ``graspmill plan …``, or ``python -m graspmill plan …``."""

import contextlib
import os
import sys

from graspmill import _commands, _native


def main() -> int:
    code = _commands.run(sys.argv[1:])
    code = _native.run_program(["graspmill", *sys.argv[1:]]) if code is None else code
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    # Not by way of Python's end: threads that Arrow is still starting would abort the program.
    os._exit(code)


if __name__ == "__main__":
    main()
