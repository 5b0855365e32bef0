"""The program: ``graspmill plan …``, or ``python -m graspmill plan …``."""

import sys

from graspmill import _commands, _native


def main() -> int:
    code = _commands.run(sys.argv[1:])
    return _native.run_program(["graspmill", *sys.argv[1:]]) if code is None else code


if __name__ == "__main__":
    sys.exit(main())
