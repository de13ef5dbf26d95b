"""`orientd doctor`: what on this machine stands in the way of real time, and how to mend it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orientd.cli.output import AsJson, command, say, say_json, table


@command
def doctor(
    config: Annotated[
        Path | None,
        typer.Option("--config", help="Look at the devices of this configuration too."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show what on this machine stands in the way of real time, and how to mend it.

    Everything is measured; that takes two seconds.  Devices are looked at, and not changed.
    """
    from orientd.cli.device_findings import device_findings
    from orientd.cli.machine import Verdict, findings

    of_devices = device_findings(config) if config else []
    found = findings() + of_devices
    count = {verdict: sum(one.verdict is verdict for one in found) for verdict in Verdict}
    if as_json:
        say_json(
            {
                "findings": [
                    {
                        "name": one.name,
                        "found": one.found,
                        "verdict": one.verdict.value,
                        "mend": one.mend,
                    }
                    for one in found
                ],
                "counts": {verdict.value: number for verdict, number in count.items()},
            }
        )
        return
    rows = [[one.verdict.value, one.name, one.found] for one in found]
    say(*table(["verdict", "what", "found"], rows), "")
    for one in found:
        if one.mend:
            say(f"{one.name}: {one.mend}")
    say(
        f"{count[Verdict.OK]} ok, {count[Verdict.IMPROVE]} to improve, "
        f"{count[Verdict.PROBLEM]} problems"
    )
