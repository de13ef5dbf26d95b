"""What the daemon tells a servo process when it starts it.

The daemon imports this module and none of those that move the device.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from orientd.keep_out import KeepOut
from orientd.sun import Sun


@dataclass(frozen=True, slots=True)
class ProcessSettings:
    """The settings of a servo process.

    Attributes:
        device: the device's name.
        driver: location of its driver class, ``module:Class``.
        options: the driver's options.
        period_ns: cycle period.
        phase_ns: start of cycles within a period of the monotonic clock.
        path_capacity: size of the path ring.
        cycle_capacity: size of the ring of cycles.
        heartbeat_timeout_ns: longest silence of the daemon in motion.
        feedback_timeout_ns: largest age of feedback.
        stall_timeout_ns: longest stall after which a motion resumes by itself.
        priority: requested SCHED_FIFO priority; 0 for none.
        spin_ns: busy-wait before each deadline.
        daemon_pid: the process that started this one.
        report_path: file for the reason why the process ended.
        stop_path: socket for stops; empty for none.
        admitted: numbers of ``users`` and ``groups`` that may stop.
        keep_out: cones of the device.
    """

    device: str
    driver: str
    options: dict[str, Any]
    period_ns: int
    phase_ns: int
    path_capacity: int
    cycle_capacity: int
    heartbeat_timeout_ns: int
    feedback_timeout_ns: int
    stall_timeout_ns: int
    priority: int
    spin_ns: int
    daemon_pid: int
    report_path: str
    stop_path: str = ""
    admitted: dict[str, list[int]] = field(default_factory=dict)
    keep_out: tuple[KeepOut, ...] = ()

    def to_json(self) -> str:
        """Return the settings as the JSON that the process reads."""
        values = asdict(self)
        for one, cone in zip(self.keep_out, values["keep_out"], strict=True):
            cone["is_sun"] = isinstance(one.direction, Sun)
        return json.dumps(values)

    @classmethod
    def from_json(cls, text: str) -> ProcessSettings:
        """Return the settings of a JSON text of :meth:`to_json`."""
        values = json.loads(text)
        cones = values.pop("keep_out")
        return cls(**values, keep_out=tuple(map(_cone, cones)))


def _cone(values: dict[str, Any]) -> KeepOut:
    """Return a cone as JSON has it, where named and plain tuples are lists."""
    direction = tuple(values["direction"])
    if values.pop("is_sun"):
        direction = Sun(*direction)
    return KeepOut(**{**values, "direction": direction, "axis": tuple(values["axis"])})
