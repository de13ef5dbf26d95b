"""The command ``emulated-ur``: a robot on an address of this machine until Ctrl-C."""

from __future__ import annotations

import argparse
import sys

from emulated_ur.arm import MODELS, Behaviour, version_of
from emulated_ur.server import serve
from emulated_ur.variables import ProgramState


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="emulated-ur",
        description="Emulate a Universal Robots controller with its arm until Ctrl-C: dashboard on "
        "port 29999, URScript on 30001 to 30003, RTDE on 30004, interpreter mode on 30020, faults "
        "on 29998 (send `help`). Prints a line that begins with `ready` when it can be used.",
    )
    parser.add_argument(
        "--host", default="127.0.0.2",
        help="an address of this machine, any of 127.0.0.0/8; each robot needs one",
    )  # fmt: skip
    parser.add_argument("--model", choices=sorted(MODELS), default="ur5e")
    parser.add_argument("--polyscope", metavar="VERSION", help="its software, as in 5.12.6")
    parser.add_argument(
        "--protective-stop-leaves", choices=("paused", "playing", "stopped"), default="paused",
        help="what a protective stop makes of the program",
    )  # fmt: skip
    parser.add_argument("--unlock-after", type=float, default=5.0, metavar="SECONDS")
    parser.add_argument("--no-breach-stop", action="store_true", help="clamp fast joints only")
    parser.add_argument("--stiff-servo", action="store_true", help="do not smooth servo commands")
    parser.add_argument("--until-end-of-input", action="store_true", help="end with the input")
    given = parser.parse_args()
    model = MODELS[given.model]
    try:
        behaviour = Behaviour(
            model=model,
            version=version_of(model, given.polyscope),
            protective_stop_leaves=ProgramState[given.protective_stop_leaves.upper()],
            unlock_after=given.unlock_after,
            stops_on_breach=not given.no_breach_stop,
            smooths_servo=not given.stiff_servo,
        )
        serve(given.host, behaviour, lifeline=0 if given.until_end_of_input else None)
    except (OSError, ValueError) as error:
        sys.exit(f"cannot serve on {given.host}: {error}")


if __name__ == "__main__":
    main()
