"""Pause and resume what a device runs; refused where it runs nothing."""

from __future__ import annotations

from orientd.daemon.device import Device
from orientd.errors import StateError
from orientd.stream import ServoState


def pause(device: Device) -> None:
    """Pause the motion that *device* runs.

    Raises:
        StateError: it runs none.
    """
    _check_moving(device, "pause")
    device.pause()


def resume(device: Device) -> None:
    """Go on with the motion that *device* has paused.

    Raises:
        StateError: it has none.
    """
    _check_moving(device, "resume")
    device.resume()


def _check_moving(device: Device, what: str) -> None:
    state = device.snapshot().state
    if state is not ServoState.STREAMING:
        raise StateError(f"device {device.name} is {state.name.lower()}: no motion to {what}")
