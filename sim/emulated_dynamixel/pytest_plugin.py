"""Fixtures of pytest: a bus on a serial port, and one in virtual time without any."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

from emulated_dynamixel.bus import Bus
from emulated_dynamixel.command import servos
from emulated_dynamixel.process import EmulatedBus
from emulated_dynamixel.virtual_port import ManualClock, VirtualPort


@pytest.fixture
def emulated_dynamixel() -> Iterator[EmulatedBus]:
    """A bus of three XM430 with ids 1 to 3 on a serial port; `port` names it."""
    with EmulatedBus() as bus:
        yield bus


@pytest.fixture
def virtual_dynamixel() -> VirtualPort:
    """A bus behind a port object of dynamixel_sdk, in virtual time: tests do not wait."""
    clock = ManualClock(1_000_000_000)
    found = servos("1:xm430,2:xm430,3:xm430", now_ns=clock.now_ns())
    return VirtualPort(Bus(found, rng=random.Random(0)), clock)
