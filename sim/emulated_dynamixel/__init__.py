"""An emulated Dynamixel bus: Protocol 2.0, ten models of servo, faults, virtual time or a pty."""

from __future__ import annotations

from emulated_dynamixel.bus import Bus
from emulated_dynamixel.command import run, servos
from emulated_dynamixel.line import FaultKind, Faults, ReplyFault, SerialLine
from emulated_dynamixel.process import EmulatedBus
from emulated_dynamixel.pty import PtyServer
from emulated_dynamixel.servo import EmulatedServo, Lie
from emulated_dynamixel.table import MODELS, XL330_M288, XM430_W350, ServoModel
from emulated_dynamixel.virtual_port import ManualClock, VirtualPort
