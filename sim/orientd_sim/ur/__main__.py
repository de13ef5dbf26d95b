"""Run an emulated UR arm: ``python -m orientd_sim.ur --host 127.0.0.2``."""

from __future__ import annotations

import argparse
import sys

from orientd_sim.ur.arm import MODELS, Behaviour, version_of
from orientd_sim.ur.server import serve
from orientd_sim.ur.variables import ProgramState


def main() -> int:
    """Read the command line and serve; return the process's exit code."""
    parser = argparse.ArgumentParser(prog="python -m orientd_sim.ur", description=__doc__)
    parser.add_argument("--host", default="127.0.0.2", help="an address of this machine")
    parser.add_argument("--model", choices=sorted(MODELS), default="ur5e")
    parser.add_argument("--polyscope", metavar="VERSION", help="as in 5.12.6")
    parser.add_argument(
        "--protective-stop-leaves", choices=("paused", "playing", "stopped"), default="paused",
        help="what a protective stop makes of the program",
    )  # fmt: skip
    parser.add_argument("--unlock-after", type=float, default=5.0, metavar="SECONDS")
    parser.add_argument("--no-breach-stop", action="store_true", help="clamp fast joints only")
    parser.add_argument(
        "--end-with-input", action="store_true", help="end when standard input does"
    )
    arguments = parser.parse_args()
    model = MODELS[arguments.model]
    behaviour = Behaviour(
        model=model,
        version=version_of(model, arguments.polyscope),
        protective_stop_leaves=ProgramState[arguments.protective_stop_leaves.upper()],
        unlock_after=arguments.unlock_after,
        stops_on_breach=not arguments.no_breach_stop,
    )
    try:
        serve(arguments.host, behaviour, lifeline=0 if arguments.end_with_input else None)
    except OSError as error:
        sys.stderr.write(f"cannot serve on {arguments.host}: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
