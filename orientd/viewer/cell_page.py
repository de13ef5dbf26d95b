"""The page of a cell: devices of all daemons beside each other, and one stop for all of them."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from orientd.rpc import DeviceReport
from orientd.viewer import freshness, geometry, web, words
from orientd.viewer.cell import Cell, Member
from orientd.viewer.controls import HALT, STOP
from orientd.viewer.scene import COLOURS, RADIUS, TO_AXIS, aim

FRAMES_HZ = 5.0
"""Half as often as daemons tell of themselves: many devices take a browser long to draw."""

SPACING = 3.0 * RADIUS
"""From one device to the next, m."""

_RED, _QUIET = (176, 42, 22), (128, 128, 128)
_FROM = np.array([0.3, -1.0, 0.6])
"""Where one looks from: x to the right, the first row farthest away."""

DISTANCE = 0.85
"""From there to the middle, as a share of how wide the devices stand."""


class CellPage:
    """One page, as every browser shows it.  It has nothing that needs a lease."""

    def __init__(self, cell: Cell, *, host: str, port: int, is_dark: bool) -> None:
        """Serve the page.

        Args:
            cell: that is shown.
            host: where to serve.
            port: where to serve; 0 for any.
            is_dark: whether pages are dark.

        Raises:
            OrientdError: the page cannot be served there.
        """
        self._cell, self._is_dark = cell, is_dark
        self._server = server = web.serve(host, port)
        self.port = server.get_port()
        server.gui.add_html(freshness.HTML)
        self._beat = server.gui.add_html("")
        stop = server.gui.add_button(
            f"{STOP} all", color=_RED, hint="Every device of the cell comes to rest on its path."
        )
        halt = server.gui.add_button(HALT, color="gray", hint="Every device of the cell.")
        stop.on_click(lambda event: self._press(event, is_quickest=False))
        halt.on_click(lambda event: self._press(event, is_quickest=True))
        self._table = server.gui.add_html("")
        self._tools: dict[str, _Tool] = {}
        server.on_client_connect(self._welcome)

    def run(self, closing: threading.Event) -> None:
        """Keep the page up to date until *closing* is set."""
        try:
            next_beat = 0.0
            while not closing.wait(1.0 / FRAMES_HZ):
                members = self._cell.members()
                with self._server.atomic():
                    self._show(members)
                now = time.monotonic()
                if now >= next_beat:
                    next_beat = now + 1.0 / freshness.BEATS_HZ
                    # How old what each daemon says is stands beside it.
                    self._beat.content = freshness.beat(now, age=0.0)
        finally:
            web.stop(self._server)

    def _show(self, members: Sequence[Member]) -> None:
        web.set_changed(self._table, content=words.cell(members))
        shown = [(member, device) for member in members for device in member.devices]
        names = [f"{member.daemon}/{device.name}" for member, device in shown]
        if names != list(self._tools):
            for tool in self._tools.values():
                tool.remove()
            places = _grid(len(names))
            self._tools = {
                name: _Tool(self._server, name, place)
                for name, place in zip(names, places, strict=True)
            }
            for client in self._server.get_clients().values():
                self._aim(client)
        for name, (member, device) in zip(names, shown, strict=True):
            self._tools[name].move(member, device)

    def stop(self, *, is_quickest: bool = False) -> str:
        """Do what the buttons do; return what is not known to have stopped, empty if nothing."""
        return self._cell.stop(is_quickest=is_quickest)

    def _press(self, event: Any, *, is_quickest: bool) -> None:  # noqa: ANN401 - the library's own
        problem = self.stop(is_quickest=is_quickest)
        if problem:
            web.complain(event, "Not acknowledged", problem)

    def _welcome(self, client: viser.ClientHandle) -> None:
        web.dress(client, is_dark=self._is_dark)
        self._aim(client)

    def _aim(self, client: viser.ClientHandle) -> None:
        """Look at the middle of all devices."""
        columns, rows = _shape(max(len(self._tools), 1))
        distance = SPACING * max(columns, 1.4 * rows, 2.0) * DISTANCE
        aim(client.camera, np.zeros(3), _FROM / np.linalg.norm(_FROM) * distance)


class _Tool:
    """The axes of one device, as sent."""

    def __init__(
        self, server: viser.ViserServer, name: str, place: tuple[float, float, float]
    ) -> None:
        scene, self._name = server.scene, name
        self._frame = scene.add_frame(f"/{name}", show_axes=False, position=place)
        self._sent = scene.add_frame(f"/{name}/sent", show_axes=False)
        vertices, faces = geometry.arrow(RADIUS, 0.01)
        for axis, (letter, colour) in enumerate(zip(geometry.AXES, COLOURS, strict=True)):
            scene.add_mesh_simple(
                f"/{name}/sent/{letter}", vertices, faces, color=colour, wxyz=TO_AXIS[axis],
                cast_shadow=False,
            )  # fmt: skip
            ring = geometry.circle(axis) * RADIUS
            scene.add_line_segments(
                f"/{name}/ring_{letter}", geometry.segments(ring), _QUIET, thickness=0.002
            )
        above = (0.0, 0.0, 1.25 * RADIUS)
        self._label = scene.add_label(f"/{name}/label", name, position=above)

    def move(self, member: Member, device: DeviceReport) -> None:
        """Show how a device is; nothing of one that is not known to be so."""
        problem = member.problem or device.is_stale
        # No state: a browser may draw a label a second after it has changed.
        web.set_changed(self._label, text=f"✕ {self._name}" if problem else self._name)
        web.set_changed(self._sent, visible=not problem and device.cycle is not None)
        if device.cycle is not None:
            self._sent.wxyz = device.cycle.q

    def remove(self) -> None:
        self._frame.remove()


def _shape(count: int) -> tuple[int, int]:
    columns = math.ceil(math.sqrt(count)) if count > 4 else count
    return columns, math.ceil(count / max(columns, 1))


def _grid(count: int) -> list[tuple[float, float, float]]:
    """Return where devices are drawn: row by row, the middle of all at the origin."""
    columns, rows = _shape(count)
    return [
        (
            SPACING * (k % columns - 0.5 * (columns - 1)),
            SPACING * (0.5 * (rows - 1) - k // columns),
            0.0,
        )
        for k in range(count)
    ]
