"""The command ``emulated-dynamixel``: servos on a pseudo-terminal until Ctrl-C."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from emulated_dynamixel.command import run
from emulated_dynamixel.line import SerialLine
from emulated_dynamixel.table import MODELS


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="emulated-dynamixel",
        description="Emulate a Dynamixel bus (Protocol 2.0) on a pseudo-terminal until Ctrl-C. "
        "Prints a line that begins with `ready` when it can be used.",
        epilog=f"Models: {', '.join(MODELS)}. With --console, `help` lists the commands.",
    )
    parser.add_argument("--link", type=Path, required=True, help="where clients find the port")
    parser.add_argument("--servos", default="1:xm430,2:xm430,3:xm430", help="ids and models")
    parser.add_argument("--baud", type=int, default=1_000_000, help="the servos' line speed")
    parser.add_argument("--usb-ms", type=float, default=1.0, help="most delay of the adapter, ms")
    parser.add_argument("--ideal", action="store_true", help="let bytes take no time")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    parser.add_argument(
        "--console", action="store_true", help="read commands from standard input: faults, `state`"
    )
    given = parser.parse_args()
    line = SerialLine(
        is_paced=not given.ideal,
        usb_latency_ns=0 if given.ideal else round(given.usb_ms * 1e6),
        has_collisions=False,
    )
    try:
        run(
            given.link, names=given.servos, baud=given.baud, line=line, seed=given.seed,
            console=0 if given.console else None,
        )  # fmt: skip
    except (OSError, ValueError) as error:
        sys.exit(f"cannot serve an emulated bus at {given.link}: {error}")


if __name__ == "__main__":
    main()
