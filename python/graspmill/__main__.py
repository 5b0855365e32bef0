"""The programs: ``graspmill generator …``, or ``python -m graspmill generator …``."""

import sys

PROGRAMS = {
    "generator": "make grasp datasets: scenes, grasp attempts in physics, labels, Parquet shards",
    "shards": "look at datasets: verify, report, browse, view, export",
    "trainer": "train and evaluate networks, from a hand's file to weights in one command",
    "planner": "plan grasps from depth images, clouds or TSDFs; as a command or as a service",
    "experiments": "clear tables in simulation and count",
}


def main() -> int:
    """Runs the program that the first argument names; returns its exit code."""
    # Imported late: --help needs no native code.
    words = sys.argv[1:]
    if not words or words[0] in ("-h", "--help", "help"):
        width = max(map(len, PROGRAMS))
        rows = "\n".join(f"  {name:{width}}  {what}" for name, what in PROGRAMS.items())
        print(f"Usage: graspmill PROGRAM [ARGUMENTS]\n\nPrograms:\n{rows}\n\ngraspmill PROGRAM --help explains each.")
        return 0 if words else 2
    if words[0] in ("-V", "--version"):
        from graspmill import __version__

        print(f"graspmill {__version__}")
        return 0
    if words[0] not in PROGRAMS:
        print(f"error: there is no program {words[0]!r}; it must be one of {', '.join(PROGRAMS)}", file=sys.stderr)
        return 2
    from graspmill import _native

    starter = [sys.executable, "-m", "graspmill"]
    return _native.run_program(words[0], [f"graspmill {words[0]}", *words[1:]], starter)


if __name__ == "__main__":
    sys.exit(main())
