"""A simulated device: each setpoint comes back as feedback, some cycles later.

Options:

``delay_cycles``
    cycles from a setpoint to its feedback, 0 to 1000; default 2.
``orientation``
    ``{w, x, y, z}`` at the start; default the identity.
``position``
    ``[x, y, z]`` in metres at the start; default the origin.
``record``
    path of a file to which the driver appends every setpoint (:mod:`orientd_loopback.recording`).
``model``
    ``module:Class`` of a body that follows the setpoints with lag and noise, for example
    ``orientd_loopback.joint:LaggedBody``.
``model_options``
    keyword arguments of the model.
``fault_file``
    path of a file that the driver reads in every cycle; while it contains ``link_lost``,
    ``feedback_stale`` or ``device_fault``, the device has that fault.
"""

from __future__ import annotations

import importlib
import os
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, BinaryIO, ClassVar, Protocol

from orientd.clock import Clock
from orientd.driver import (
    ZERO,
    Driver,
    Feedback,
    Quaternion,
    Setpoint,
    Vector3,
    check_names,
    numbers,
    quaternion,
    whole,
)
from orientd.errors import DeviceFaultError, LinkError
from orientd_loopback.recording import pack_setpoint

_OPTIONS = (
    "delay_cycles",
    "orientation",
    "position",
    "record",
    "model",
    "model_options",
    "fault_file",
)
_FAULTS = ("link_lost", "feedback_stale", "device_fault")


class BodyModel(Protocol):
    """A body that follows an orientation."""

    def place(self, q: Quaternion) -> None:
        """Stand still at *q*."""

    def follow(self, q: Quaternion, period: float) -> tuple[Quaternion, Vector3]:
        """Move for *period* seconds towards *q*; return orientation and body velocity."""


class LoopbackDriver(Driver):
    """Return the written setpoints with a delay."""

    name: ClassVar[str] = "loopback"

    def __init__(self, options: Mapping[str, Any], *, period_ns: int, clock: Clock) -> None:
        super().__init__(options, period_ns=period_ns, clock=clock)
        check_names(options, _OPTIONS)
        self._delay = whole("delay_cycles", options.get("delay_cycles", 2), 0, 1000)
        self._q = quaternion("orientation", options.get("orientation"))
        x, y, z = numbers("position", options.get("position", ZERO), 3)
        self._position = (x, y, z)
        self._record_path = _text("record", options.get("record"))
        self._fault_path = _text("fault_file", options.get("fault_file"))
        self._model = _model(options.get("model"), options.get("model_options", {}))
        self._omega = ZERO
        self._is_enabled = False
        self._recording: BinaryIO | None = None
        self._pending: deque[Feedback] = deque(maxlen=self._delay + 1)
        self._newest: Feedback | None = None

    def open(self) -> None:
        """Start the recording, if one is configured."""
        if self._record_path:
            try:
                # Appended without a buffer, so that the file survives the process.
                self._recording = open(self._record_path, "ab", buffering=0)  # noqa: SIM115, PTH123
            except OSError as error:
                raise LinkError(f"cannot record to {self._record_path}: {error}") from error

    def enable(self) -> Feedback:
        """Hold the current pose."""
        fault = self._fault()
        if fault:
            raise DeviceFaultError(f"injected fault: {fault}")
        if self._model is not None:
            self._model.place(self._q)
        self._pending.clear()
        self._is_enabled = True
        self._newest = Feedback(self.clock.now_ns(), self._q, ZERO, self._position)
        return self._newest

    def read(self) -> Feedback | None:
        """Return the setpoint of ``delay_cycles`` cycles ago as the measurement."""
        fault = self._fault() if self._fault_path else ""
        if fault == "link_lost":
            raise LinkError("injected fault: link_lost")
        if fault == "device_fault":
            raise DeviceFaultError("injected fault: device_fault")
        # The last setpoints still arrive once no more are written.
        kept = self._delay if self._is_enabled else 0
        if len(self._pending) > kept and fault != "feedback_stale":
            self._newest = self._pending.popleft()
        return self._newest

    def write(self, setpoint: Setpoint) -> None:
        """Use *setpoint* as the new orientation."""
        self._q, self._omega, self._position = setpoint.q, setpoint.omega_body, setpoint.position
        if self._model is not None:
            self._q, self._omega = self._model.follow(setpoint.q, self.period_ns * 1e-9)
        if len(self._pending) > self._delay:
            self._pending.popleft()
        self._pending.append(Feedback(self.clock.now_ns(), self._q, self._omega, self._position))
        if self._recording is not None:
            self._recording.write(pack_setpoint(setpoint))

    def disable(self) -> None:
        """Do nothing: the device stays."""
        self._is_enabled = False

    def close(self) -> None:
        """End the recording."""
        if self._recording is not None:
            self._recording.close()
            self._recording = None

    def _fault(self) -> str:
        if not self._fault_path:
            return ""
        try:
            descriptor = os.open(self._fault_path, os.O_RDONLY)
        except FileNotFoundError:
            return ""
        try:
            fault = os.read(descriptor, 64).decode().strip()
        finally:
            os.close(descriptor)
        return fault if fault in _FAULTS else ""


def _text(option: str, given: object) -> str:
    if given is not None and not isinstance(given, str):
        raise ValueError(f"{option} must be a path, got {given!r}")
    return given or ""


def _model(target: object, options: object) -> BodyModel | None:
    if target is None:
        return None
    if not isinstance(target, str) or ":" not in target:
        raise ValueError(f"model must be 'module:Class', got {target!r}")
    if not isinstance(options, Mapping):
        raise ValueError(f"model_options must be a table, got {options!r}")
    module, _, name = target.partition(":")
    try:
        make: Callable[..., BodyModel] = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"model {target!r} cannot be loaded: {error}") from error
    try:
        return make(**options)
    except TypeError as error:
        raise ValueError(f"model_options do not fit {target}: {error}") from error
