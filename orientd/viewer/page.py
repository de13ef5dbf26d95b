"""The page: everything on it, and the loop that keeps it up to date."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import viser

from orientd.rpc import Robot
from orientd.viewer import freshness, web, words
from orientd.viewer.charts import Charts
from orientd.viewer.controls import KINDS, Controls, add_stop_buttons
from orientd.viewer.scene import RADIUS, Scene, aim
from orientd.viewer.stop_relay import StopRelay
from orientd.viewer.watcher import Sight, Watcher

FRAMES_HZ = 30.0
CHARTS_HZ = 8.0
LONELY = 10.0
"""How long after the last page has gone the lease is given back, s."""

_NEAR, _FAR = (1.9, 1.9, 1.0), (4.2, 3.4, 1.8)
"""Where one looks from, in radii of the sphere from its centre: at a tool, at an arm."""


class Page:
    """One page, as every browser shows it."""

    def __init__(
        self,
        connect: Callable[[], Robot],
        *,
        host: str,
        port: int,
        may_command: bool,
        is_dark: bool,
        is_beside: bool = False,
    ) -> None:
        """Connect to the daemon and serve the page.

        Args:
            connect: makes a connection to the daemon.
            host: where to serve.
            port: where to serve; 0 for any.
            may_command: whether the page has more than stop and halt.
            is_dark: whether pages are dark at first.
            is_beside: whether to command beside what the same user runs elsewhere.

        Raises:
            OrientdError: no daemon answers, or the page cannot be served there.
        """
        self._is_dark = is_dark
        self._watcher = watcher = Watcher(connect)
        watcher.start()
        try:
            self._server = server = web.serve(host, port)
        except BaseException:
            watcher.close()
            raise
        self.port = server.get_port()
        server.gui.add_html(freshness.HTML)
        self._beat = server.gui.add_html("")
        self._next_beat = 0.0
        self._status = server.gui.add_html("")
        add_stop_buttons(server, watcher)
        self._relay: StopRelay | None = None
        daemon = watcher.robot().local_socket
        if daemon is not None:
            self._relay = StopRelay(host, self.port, daemon, KINDS)
            server.gui.add_html(self._relay.html)
        self._add_choice()
        self._controls: Controls | None = None
        if may_command:
            with server.gui.add_folder("Control", expand_by_default=True):
                self._controls = Controls(server, watcher, is_beside=is_beside)
        self._folder = server.gui.add_folder("Last ten seconds")
        self._charts: Charts | None = None
        self._charted = ""
        self._scene = Scene(server)
        self._left: float | None = None
        self._next_charts = 0.0
        server.on_client_connect(self._welcome)

    def run(self, closing: threading.Event) -> None:
        """Keep the page up to date until *closing* is set."""
        try:
            while not closing.wait(1.0 / FRAMES_HZ):
                self._frame(time.monotonic())
        finally:
            self._watcher.close()
            if self._relay is not None:
                self._relay.close()
            web.stop(self._server)

    def _frame(self, now: float) -> None:
        sight = self._watcher.sight
        self._notice_pages(now)
        if now >= self._next_beat:
            self._next_beat = now + 1.0 / freshness.BEATS_HZ
            self._beat.content = freshness.beat(now, sight.age(now))
        had_device = self._scene.has_device
        with self._server.atomic():
            self._scene.move(sight.cycle, sight.outline)
            self._scene.show_path("path", sight.plan)
            if self._controls is not None:
                self._controls.show(sight)
                self._scene.show_path("proposal", self._controls.proposal.plan, prefix="+")
            self._show_status(sight, now)
        if self._scene.has_device and not had_device:
            for client in self._server.get_clients().values():
                self._aim(client)
        if now >= self._next_charts:
            self._next_charts = now + 1.0 / CHARTS_HZ
            self._show_charts(sight)

    def _notice_pages(self, now: float) -> None:
        """Have cycles flow while a page is open; soon after the last one, give the lease back."""
        is_seen = bool(self._server.get_clients())
        self._watcher.watch(is_seen)
        if is_seen:
            self._left = None
        elif self._left is None:
            self._left = now
        elif now - self._left > LONELY and self._controls is not None:
            self._controls.give_up()

    def _show_status(self, sight: Sight, now: float) -> None:
        report, problem = sight.report, sight.trouble(now)
        if sight.cell is None or report is None:
            text = words.trouble(problem)
        else:
            is_ours = self._controls is not None and self._controls.is_ours(sight)
            text = words.status(
                report,
                sight.cell.daemon,
                is_ours=is_ours,
                problem=problem,
                is_connected=not sight.problem,
            )
        web.set_changed(self._status, content=text)

    def _show_charts(self, sight: Sight) -> None:
        report = sight.report
        if report is None:
            return
        if self._charted != report.name:
            if self._charts is not None:
                self._charts.remove()
            with self._folder:
                self._charts = Charts(self._server, report)
            self._charted = report.name
        if self._charts is not None and self._server.get_clients():
            self._charts.show(*self._watcher.strips.read(), sight.plan)

    def _add_choice(self) -> None:
        cell = self._watcher.sight.cell
        names = list(cell.devices) if cell is not None else []
        if len(names) > 1:
            choice = self._server.gui.add_dropdown("Device", names)
            choice.on_update(lambda _: self._watcher.choose(choice.value))

    # Each browser's own

    def _welcome(self, client: viser.ClientHandle) -> None:
        self._watcher.watch(True)
        is_dark = client.gui.add_checkbox("Dark", self._is_dark, order=1e9)
        is_dark.on_update(lambda _: web.dress(client, is_dark=is_dark.value))
        web.dress(client, is_dark=self._is_dark)
        self._aim(client)

    def _aim(self, client: viser.ClientHandle) -> None:
        """Look at the tool."""
        cycle = self._watcher.sight.cycle
        target = np.array(cycle.position if cycle is not None else (0.0, 0.0, 0.0))
        away = np.array(_FAR if self._scene.has_device else _NEAR) * RADIUS
        aim(client.camera, target, away)
