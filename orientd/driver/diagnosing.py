"""Inspect a device from the environment of its driver; ``orientd doctor`` starts this.

Reads the driver, its options and its period as JSON from standard input, and writes the findings as
JSON to standard output.
"""

from __future__ import annotations

import contextlib
import json
import pkgutil
import sys

from orientd.clock import MonotonicClock
from orientd.driver.contract import Driver
from orientd.driver.protocols import Diagnosable, Finding


def findings_of(driver: Driver) -> list[Finding]:
    """Return the findings of *driver* about its device; empty if it cannot inspect one."""
    return list(driver.diagnose()) if isinstance(driver, Diagnosable) else []


def needs(error: ModuleNotFoundError) -> str:
    """Return the finding that a package of the driver is missing in this environment."""
    return f"the driver needs the package {error.name!r}, which {sys.executable} does not have"


def main() -> None:
    """Read the request, inspect the device and write the findings."""
    asked = json.load(sys.stdin)
    try:
        # A vendor's library may print to standard output.
        with contextlib.redirect_stdout(sys.stderr):
            kind: type[Driver] = pkgutil.resolve_name(asked["driver"])
            driver = kind(asked["options"], period_ns=asked["period_ns"], clock=MonotonicClock())
            found = findings_of(driver)
    except ModuleNotFoundError as error:
        sys.exit(needs(error))
    json.dump([[one.name, one.found, one.verdict.value, one.mend] for one in found], sys.stdout)


if __name__ == "__main__":
    main()
