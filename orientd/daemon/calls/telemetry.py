"""What a Prometheus server scrapes: how punctual the servos are, what moves, and who asks.

``prometheus-client`` is imported only where a port is configured.  Cycles are counted by a thread
that reads what the servos have published anyhow; no servo and no call waits for it.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import orientd
from orientd.config import MetricsSettings
from orientd.daemon.calls.report import CycleReader, cycle_age
from orientd.daemon.device import Device
from orientd.daemon.devices import DeviceEvent, EventKind
from orientd.errors import ConfigError
from orientd.stream import Cycle, ServoState

_log = logging.getLogger(__name__)

SAMPLING = 0.25
"""Seconds between looks at the cycles."""

RECENT = 100
"""Cycles that the success ratio is of."""

LATENESS_BUCKETS = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 1e-1)
CALL_BUCKETS = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1, 1.0, 3.0, 10.0, 100.0)

_OUTCOMES = {
    EventKind.MOTION_DONE: "done",
    EventKind.MOTION_PASSED: "passed",
    EventKind.MOTION_STOPPED: "stopped",
    EventKind.MOTION_REPLACED: "replaced",
    EventKind.MOTION_UNSETTLED: "unsettled",
}


class Telemetry:
    """Every metric of one daemon, in a registry of its own."""

    def __init__(self) -> None:
        """Make the metrics, all of them at nothing.

        Raises:
            ConfigError: ``prometheus-client`` is not installed.
        """
        try:
            import prometheus_client as prometheus
        except ImportError as error:
            raise ConfigError(
                "metrics need `prometheus-client`: pip install 'orientd-motion[metrics]'"
            ) from error
        self._prometheus = prometheus
        self.registry = prometheus.CollectorRegistry()
        kept: dict[str, Any] = {"namespace": "orientd", "registry": self.registry}
        counter: Any = functools.partial(prometheus.Counter, **kept)
        gauge: Any = functools.partial(prometheus.Gauge, **kept)
        histogram: Any = functools.partial(prometheus.Histogram, **kept)
        device = ["device"]
        self._cycles = counter("cycles", "Cycles of the servo.", device)
        self._overruns = counter(
            "cycle_overruns", "Cycles that began more than half a period late.", device
        )
        self._missed = counter(
            "cycle_missed_deadlines", "Deadlines that were left out altogether.", device
        )
        self._faults = counter("faults", "Faults of a device.", ["device", "kind"])
        self._motions = counter("motions", "Motions that have ended.", ["device", "outcome"])
        self._calls = counter("rpcs", "Calls that were answered.", ["method", "code"])
        self._lateness = histogram(
            "cycle_lateness_seconds", "How late cycles began.", device, buckets=LATENESS_BUCKETS
        )
        self._call_times = histogram(
            "rpc_duration_seconds",
            "From a call to the end of its answer.",
            ["method"],
            buckets=CALL_BUCKETS,
        )
        self._driver_calls = gauge(
            "driver_call_longest_seconds",
            "Longest read or write of the driver since its servo process started.",
            ["device", "call"],
        )
        self._age = gauge(
            "feedback_age_seconds",
            "How old the newest feedback was when its cycle was due.",
            device,
        )
        self._cycle_age = gauge(
            "cycle_age_seconds", "How long ago the newest cycle was due.", device
        )
        self._success = gauge(
            "cycle_success_ratio", f"Of the last {RECENT} cycles, those that were in time.", device
        )
        self._error = gauge(
            "tracking_error_radians", "Angle between where a device is and is to be.", device
        )
        self._state = gauge(
            "device_state", "1 for the state that a device is in.", ["device", "state"]
        )
        part = ["device", "part"]
        self._voltage = gauge("part_voltage_volts", "Supply of a servo.", part)
        self._temperature = gauge("part_temperature_celsius", "Temperature of a servo.", part)
        self._current = gauge("part_current_amperes", "Current of a servo.", part)
        self._part_age = gauge("part_health_age_seconds", "How long ago these were measured.", part)
        self._warnings = counter("warnings", "Warnings of a device.", device)
        build = gauge("build_info", "1, with the version.", ["version"])
        build.labels(orientd.__version__).set(1)
        self._followed: list[_Followed] = []
        self._done = threading.Event()
        self._thread: threading.Thread | None = None
        self._server: Any = None

    def follow(self, devices: Mapping[str, Device]) -> None:
        """Count the cycles of *devices* from now on."""
        self._followed = [_Followed(device) for device in devices.values()]
        self._thread = threading.Thread(target=self._watch, name="telemetry", daemon=True)
        self._thread.start()

    def serve(self, settings: MetricsSettings) -> int:
        """Answer Prometheus at a port of the loopback interface; return the port.

        Raises:
            ConfigError: the port is in use.
        """
        try:
            self._server, _ = self._prometheus.start_http_server(
                settings.port, addr="127.0.0.1", registry=self.registry
            )
        except OSError as error:
            raise ConfigError(
                f"metrics.port: cannot listen at 127.0.0.1:{settings.port}: {error.strerror}"
            ) from error
        port = int(self._server.server_port)
        _log.info("metrics: http://127.0.0.1:%d/metrics", port)
        return port

    def close(self) -> None:
        """Answer no more, and count no more."""
        self._done.set()
        if self._thread is not None:
            self._thread.join()
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()

    # What is told

    def hear(self, event: DeviceEvent, device: Device) -> None:
        """Count an event of *device*."""
        if event.kind in (EventKind.FAULT, EventKind.SERVO_DIED):
            kind = device.snapshot().fault.name.lower()
            self._faults.labels(event.device, kind).inc()
        if event.kind is EventKind.WARNING:
            self._warnings.labels(event.device).inc()
        outcome = _OUTCOMES.get(event.kind)
        if outcome is not None:
            if outcome == "stopped" and device.snapshot().state is ServoState.FAULT:
                outcome = "fault"
            self._motions.labels(event.device, outcome).inc()

    def count_call(self, method: str, code: str, seconds: float) -> None:
        """Count a call that took *seconds* and ended with *code*."""
        self._calls.labels(method, code).inc()
        self._call_times.labels(method).observe(seconds)

    # What is looked at

    def _watch(self) -> None:
        while not self._done.wait(SAMPLING):
            self.sample()

    def sample(self) -> None:
        """Count the cycles since the last look."""
        for followed in self._followed:
            name = followed.device.name
            lateness = self._lateness.labels(name)
            cycles, lost = followed.reader.read()
            overruns, missed = followed.count(cycles)
            for cycle in cycles:
                lateness.observe(cycle.lateness_ns * 1e-9)
            self._cycles.labels(name).inc(len(cycles) + lost)
            self._overruns.labels(name).inc(overruns)
            self._missed.labels(name).inc(missed)
            if followed.recent:
                self._success.labels(name).set(sum(followed.recent) / len(followed.recent))
            now = followed.device.snapshot()
            for state in ServoState:
                self._state.labels(name, state.name.lower()).set(state is now.state)
            self._cycle_age.labels(name).set(cycle_age(now.cycle))
            if now.cycle is not None and now.cycle.has_feedback:
                self._age.labels(name).set(now.cycle.feedback_age_ns * 1e-9)
            if now.tracking_error is not None:
                self._error.labels(name).set(now.tracking_error)
            for call, seconds in now.longest_calls.items():
                self._driver_calls.labels(name, call).set(seconds)
            for part in now.health:
                measured = (
                    (self._voltage, part.voltage),
                    (self._temperature, part.temperature),
                    (self._current, part.current),
                    (self._part_age, (time.monotonic_ns() - part.time_ns) * 1e-9),
                )
                for gauge, value in measured:
                    if value is not None:
                        gauge.labels(name, part.name).set(value)


class _Followed:
    """One device, and what was counted of it last."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.reader = CycleReader(device)
        self.recent: deque[bool] = deque(maxlen=RECENT)
        self._half_ns = 0.5e9 / device.rate_hz
        self._last: tuple[int, int] | None = None

    def count(self, cycles: list[Cycle]) -> tuple[int, int]:
        """Return how many of *cycles* were overruns, and how many deadlines were missed by them."""
        overruns = missed = 0
        for cycle in cycles:
            counted = cycle.overruns, cycle.missed
            pairs = zip(counted, self._last or counted, strict=True)
            # A servo process that was started anew counts from the beginning.
            late, left_out = (now - last if now >= last else now for now, last in pairs)
            overruns += late
            missed += left_out
            self.recent.extend([False] * min(left_out, RECENT))
            self.recent.append(cycle.lateness_ns <= self._half_ns)
            self._last = counted
        return overruns, missed
