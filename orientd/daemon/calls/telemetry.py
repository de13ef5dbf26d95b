"""Serve metrics to Prometheus: punctuality of the servos, motions, and calls by client.

``prometheus-client`` is imported only where a port is configured.  Cycles are counted by a thread
that reads what the servos have published anyhow; no servo and no call waits for it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import orientd
from orientd.config import MetricsSettings
from orientd.daemon.calls.report import CycleReader, cycle_age
from orientd.daemon.device import Device, DeviceEvent, EventKind
from orientd.daemon.workers import LoopErrors
from orientd.errors import ConfigError
from orientd.own_socket import ClientListener
from orientd.stream.records import Cycle, ServoState

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


_DEVICE, _PART = ("device",), ("device", "part")

COUNTERS = {
    "cycles": ("Cycles of the servo.", _DEVICE),
    "cycle_overruns": ("Cycles that began more than half a period late.", _DEVICE),
    "cycle_missed_deadlines": ("Deadlines that were left out altogether.", _DEVICE),
    "faults": ("Faults of a device.", ("device", "kind")),
    "motions": ("Motions that have ended.", ("device", "outcome")),
    "rpcs": ("Calls that were answered.", ("method", "code")),
    "warnings": ("Warnings of a device.", _DEVICE),
}
GAUGES = {
    "driver_call_longest_seconds": (
        "Longest read or write since the servo began.",
        ("device", "call"),
    ),
    "feedback_age_seconds": ("Age of the newest feedback when its cycle was due.", _DEVICE),
    "cycle_age_seconds": ("How long ago the newest cycle was due.", _DEVICE),
    "cycle_success_ratio": (f"Of the last {RECENT} cycles, those in time.", _DEVICE),
    "tracking_error_radians": ("Angle from the setpoint due to the measurement.", _DEVICE),
    "device_state": ("1 for the state that a device is in.", ("device", "state")),
    "part_voltage_volts": ("Supply of a servo.", _PART),
    "part_temperature_celsius": ("Temperature of a servo.", _PART),
    "part_current_amperes": ("Current of a servo.", _PART),
    "part_health_age_seconds": ("How long ago these were measured.", _PART),
    "build_info": ("1, with the version.", ("version",)),
}
HISTOGRAMS = {
    "cycle_lateness_seconds": ("How late cycles began.", _DEVICE, LATENESS_BUCKETS),
    "rpc_duration_seconds": ("From a call to the end of its answer.", ("method",), CALL_BUCKETS),
}
"""Description and labels of every metric by its name, and the buckets of histograms."""


class Telemetry:
    """Every metric of one daemon, in a registry of its own.

    Attributes:
        registry: of the library.
        port: where Prometheus finds it; 0 if it is not served.
    """

    def __init__(
        self, settings: MetricsSettings | None = None, devices: Mapping[str, Device] | None = None
    ) -> None:
        """Count the cycles of *devices* from now on.

        Args:
            settings: the port at which to serve the metrics; ``None`` to serve them nowhere.
            devices: by name.

        Raises:
            ConfigError: the port is in use, or ``prometheus-client`` is not installed.
        """
        try:
            import prometheus_client as prometheus
        except ImportError as error:
            raise ConfigError(
                "metrics need `prometheus-client`: pip install 'orientd-motion[metrics]'"
            ) from error
        self.registry = prometheus.CollectorRegistry()
        kept: dict[str, Any] = {"namespace": "orientd", "registry": self.registry}
        self._metrics: dict[str, Any] = {}
        for name, (text, labels) in COUNTERS.items():
            self._metrics[name] = prometheus.Counter(name, text, labels, **kept)
        for name, (text, labels) in GAUGES.items():
            self._metrics[name] = prometheus.Gauge(name, text, labels, **kept)
        for name, (text, labels, buckets) in HISTOGRAMS.items():
            self._metrics[name] = prometheus.Histogram(name, text, labels, buckets=buckets, **kept)
        self._of("build_info", orientd.__version__).set(1)
        self.port, self._server = 0, None
        if settings is not None:
            self._server = self._serve(prometheus, settings)
            self.port = int(self._server.server_port)
            _log.info("metrics: http://127.0.0.1:%d/metrics", self.port)
        self._followed = [_Followed(device) for device in (devices or {}).values()]
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="telemetry", daemon=True)
        self._thread.start()

    def _serve(self, prometheus: Any, settings: MetricsSettings) -> Any:  # noqa: ANN401 - optional
        """Answer Prometheus at a port of the loopback interface."""
        try:
            server, _ = prometheus.start_http_server(
                settings.port, addr="127.0.0.1", registry=self.registry
            )
        except OSError as error:
            raise ConfigError(
                f"metrics.port: cannot listen at 127.0.0.1:{settings.port}: {error.strerror}"
            ) from error
        server.socket.listen()  # its own queue holds five clients; others would wait for 1 s
        self._listener = ClientListener(server.socket)
        server.get_request = self._listener.accept
        return server

    def close(self) -> None:
        """Answer no more, and count no more."""
        self._done.set()
        self._thread.join()
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._listener.close()

    def _of(self, name: str, *labels: str) -> Any:  # noqa: ANN401 - of the library
        return self._metrics[name].labels(*labels)

    # Events and calls

    def on_event(self, event: DeviceEvent, device: Device) -> None:
        """Count an event of *device*."""
        if event.kind in (EventKind.FAULT, EventKind.SERVO_DIED):
            self._of("faults", event.device, device.snapshot().fault.name.lower()).inc()
        if event.kind is EventKind.WARNING:
            self._of("warnings", event.device).inc()
        outcome = _OUTCOMES.get(event.kind)
        if outcome is not None:
            if outcome == "stopped" and device.snapshot().state is ServoState.FAULT:
                outcome = "fault"
            self._of("motions", event.device, outcome).inc()

    def count_call(self, method: str, code: str, seconds: float) -> None:
        """Count a call that took *seconds* and ended with *code*."""
        self._of("rpcs", method, code).inc()
        self._of("rpc_duration_seconds", method).observe(seconds)

    # What is looked at

    def _watch(self) -> None:
        errors = LoopErrors(_log, "metrics: cycles are not counted")
        while not self._done.wait(SAMPLING):
            with errors.logged():
                self.sample()

    def sample(self) -> None:
        """Count the cycles since the last look."""
        for followed in self._followed:
            self._count(followed)
            self._measure(followed.device)

    def _count(self, followed: _Followed) -> None:
        name = followed.device.name
        cycles, lost = followed.reader.read()
        overruns, missed = followed.count(cycles)
        lateness = self._of("cycle_lateness_seconds", name)
        for cycle in cycles:
            lateness.observe(cycle.lateness_ns * 1e-9)
        self._of("cycles", name).inc(len(cycles) + lost)
        self._of("cycle_overruns", name).inc(overruns)
        self._of("cycle_missed_deadlines", name).inc(missed)
        if followed.recent:
            ratio = sum(followed.recent) / len(followed.recent)
            self._of("cycle_success_ratio", name).set(ratio)

    def _measure(self, device: Device) -> None:
        now, name = device.snapshot(), device.name
        for state in ServoState:
            self._of("device_state", name, state.name.lower()).set(state is now.state)
        self._of("cycle_age_seconds", name).set(cycle_age(now.cycle))
        if now.cycle is not None and now.cycle.has_feedback:
            self._of("feedback_age_seconds", name).set(now.cycle.feedback_age_ns * 1e-9)
        if now.tracking_error is not None:
            self._of("tracking_error_radians", name).set(now.tracking_error)
        for call, seconds in now.longest_calls.items():
            self._of("driver_call_longest_seconds", name, call).set(seconds)
        for part in now.health:
            measured = {
                "part_voltage_volts": part.voltage,
                "part_temperature_celsius": part.temperature,
                "part_current_amperes": part.current,
                "part_health_age_seconds": (time.monotonic_ns() - part.time_ns) * 1e-9,
            }
            for metric, value in measured.items():
                if value is not None:
                    self._of(metric, name, part.name).set(value)


class _Followed:
    """One device and its newest counts."""

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
            # A restarted servo process counts from zero.
            late, left_out = (now - last if now >= last else now for now, last in pairs)
            overruns += late
            missed += left_out
            self.recent.extend([False] * min(left_out, RECENT))
            self.recent.append(cycle.lateness_ns <= self._half_ns)
            self._last = counted
        return overruns, missed
