"""The servo processes of devices: started, asked, heard, lost, started again."""

from __future__ import annotations

from orientd.daemon.devices.cycle_memory import CycleMemory
from orientd.daemon.devices.device_report import STOPPED, DeviceEvent, DeviceSnapshot, EventKind
from orientd.daemon.devices.servo_link import ServoLink, report_directory, servo_limits_of
from orientd.daemon.devices.servo_supervisor import ServoSupervisor
