"""One device of the daemon: its servo process, and the motions that run on it."""

from __future__ import annotations

from orientd.daemon.device.cycle_memory import CycleMemory
from orientd.daemon.device.device import GONE, TICK, Device
from orientd.daemon.device.event import DeviceEvent, EventKind
from orientd.daemon.device.queue import servo_limits_of
from orientd.daemon.device.queued_motion import (
    AT_ONCE,
    ArrivalCondition,
    MoveOptions,
    QueuedMotion,
)
from orientd.daemon.device.snapshot import DeviceSnapshot
