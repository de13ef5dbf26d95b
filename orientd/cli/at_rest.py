"""What is said of devices that were told to come to rest."""

from __future__ import annotations

from orientd.cli import texts
from orientd.cli.output import answer
from orientd.rpc import DeviceReport


def tell(reports: list[DeviceReport], *, as_json: bool) -> None:
    """Say what each device was doing when it was told."""
    lines = [f"{report.name}: {texts.state(report)}" for report in reports]
    answer({"devices": reports}, *lines, as_json=as_json)
