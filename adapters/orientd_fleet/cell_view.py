"""The page of a cell: the devices of all daemons side by side, and one stop for all."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import to_quaternion
from orientd.viewer.server import PageServer
from orientd.viewer.words import FAULTS, Line, current
from orientd_fleet.overview import Member, Overview

SPACING = 0.9
"""From one device to the next, m."""


class CellView:
    """The page of a cell.  It has nothing that needs a lease."""

    def __init__(self, cell: Overview, *, host: str, port: int, is_dark: bool) -> None:
        """Serve the page.

        Args:
            cell: the cell that is shown.
            host: where to serve.
            port: where to serve; 0 for any.
            is_dark: whether pages are dark at first.

        Raises:
            OrientdError: the page cannot be served there.
        """
        self._cell, self._is_dark = cell, is_dark
        self._server = PageServer(host, port, self)
        self.port = self._server.port

    def run(self, closing: threading.Event) -> None:
        """Serve until *closing* is set."""
        closing.wait()
        self._server.close()

    def picture(self, _seen: dict[str, Any]) -> dict[str, Any]:
        """See :class:`~orientd.viewer.server.Source`."""
        members = self._cell.members()
        shown = [(member, device) for member in members for device in member.devices]
        columns = math.ceil(math.sqrt(len(shown))) if len(shown) > 4 else max(len(shown), 1)
        rows = math.ceil(len(shown) / columns)
        tools = []
        for place, (member, device) in enumerate(shown):
            row, column = divmod(place, columns)
            x, y = 0.5 * (rows - 1) - row, column - 0.5 * (columns - 1)
            is_known = not (member.problem or device.is_stale) and device.HasField("cycle")
            tools.append({
                "name": f"{member.daemon}/{device.name}",
                "at": [SPACING * x, SPACING * y, 0.0],
                "q": to_quaternion(device.cycle.q) if is_known else None,
                "problem": not is_known,
            })  # fmt: skip
        return {
            # Each line says how old it is.
            "said": time.monotonic(),
            "age": 0.0,
            "dark": self._is_dark,
            "control": None,
            "tools": tools,
            "status": lines(members),
        }

    def do(self, request: Mapping[str, Any]) -> None:
        """Stop every device of the cell.

        Raises:
            OrientdError: a device did not acknowledge it.
        """
        if request["do"] in ("stop", "halt"):
            problem = self._cell.stop(is_quickest=request["do"] == "halt")
            if problem:
                raise OrientdError(f"not acknowledged: {problem}")


def lines(members: Sequence[Member]) -> list[Line]:
    """Return the daemons of a cell, what their devices do, and how old that is."""
    if not members:
        return [("alert", "✕ Not connected", "There is no daemon in this cell.")]
    shown: list[Line] = []
    for member in members:
        shown.append(("title", member.daemon, _age(member)))
        if member.problem:
            shown.append(("alert", "✕ Out of date", f"{member.daemon} {member.problem}"))
        for device in member.devices:
            is_known = not (member.problem or device.is_stale)
            _, word, more = current(device, is_known=is_known)
            shown.append(("current", f"{device.name}: {word}", more))
            if device.state == pb.STATE_FAULT:
                shown.append(("alert", f"⚠ {FAULTS[device.fault]}", device.fault_text))
    return shown


def _age(member: Member) -> str:
    """Return the age of a daemon's report in words, in steps slow enough to read."""
    if member.age is None:
        return ""
    text = "less than 0.3 s old" if member.age < 0.3 else f"{member.age:.1f} s old"
    is_vague = member.age_bound is not None and member.age_bound > 0.1
    return f"{text} (±{member.age_bound:.1f} s)" if is_vague else text
