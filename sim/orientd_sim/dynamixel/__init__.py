"""An emulated Dynamixel bus: Protocol 2.0, two kinds of servo, faults, virtual time or a pty."""

from __future__ import annotations

from orientd_sim.dynamixel.bus import Bus
from orientd_sim.dynamixel.command import run
from orientd_sim.dynamixel.line import FaultKind, Faults, ReplyFault, SerialLine
from orientd_sim.dynamixel.pty import PtyServer
from orientd_sim.dynamixel.servo import EmulatedServo, Lie
from orientd_sim.dynamixel.table import MODELS, XL330_M288, XM430_W350, ServoModel
