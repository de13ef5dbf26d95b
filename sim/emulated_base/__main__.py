"""The command ``python -m emulated_base``: samples of a moving base until Ctrl-C."""

from __future__ import annotations

import argparse
import math
import sys

from emulated_base.command import run
from emulated_base.imu import Imu
from emulated_base.motion import BASES, BaseMotion


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="emulated-base",
        description="Print the orientation and rate of a moving base as lines of JSON.",
    )
    parser.add_argument("--kind", choices=list(BASES), default="ship", help="the base")
    parser.add_argument("--rate", type=float, default=100.0, help="samples a second")
    parser.add_argument("--dropouts", type=float, default=0.0, help="share of lost samples")
    parser.add_argument("--seconds", type=float, default=math.inf, help="how long")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    given = parser.parse_args()
    try:
        imu = Imu(rate_hz=given.rate, dropouts=given.dropouts, seed=given.seed)
    except ValueError as error:
        sys.exit(f"emulated-base: {error}")
    run(BaseMotion(given.kind, given.seed), imu, seconds=given.seconds)


if __name__ == "__main__":
    main()
