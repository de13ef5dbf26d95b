"""The client library's objects, and safe ways to call them.

The library (``ur-rtde``) reconnects by itself, and then may crash the process.  After a loss some
of its calls last five minutes, and its destructors may abort.  Three rules follow, and this module
enforces them.  Check that the link lives before each call.  Never call again once it does not.  Put
a bound on every call that can wait.  All calls run on the caller's thread.

Its constructors hold the interpreter's lock, so no Python thread or signal handler could end a
hanging call.  A C thread or a kernel timer ends the process instead.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import importlib.util
import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from orientd.errors import DeviceFaultError, LinkError, SpentLinkError
from orientd_ur.controller import RuntimeState
from orientd_ur.wire import RTDE_PORT, SCRIPT_PORT, RtdeClient

VARIABLES = [
    "timestamp",
    "target_q",
    "actual_q",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "target_TCP_pose",
    "speed_scaling",
    "target_speed_fraction",
    "robot_mode",
    "safety_mode",
    "runtime_state",
]

_CONSTRUCTION_LIMIT = 8.0
_CALL_LIMIT = 3.0
_REGISTER_RETRIES = 10
_CLEARED = 1.0
# Every controller can send as often.
_REGISTER_RATE = 125.0

# Connected objects are never destroyed, because their destructors may hang or abort.  The process
# ends without them.
_KEPT: list[Any] = []


@contextlib.contextmanager
def process_ends_after(seconds: float) -> Iterator[None]:
    """End the process, exit status 1, if the block takes longer than *seconds*.

    The supervising process sees its end; the traceback goes to standard error.
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=sys.__stderr__ or sys.stderr)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


@contextlib.contextmanager
def alarm_after(seconds: float) -> Iterator[None]:
    """Let the kernel end the process if the block takes longer; for calls in every cycle.

    A kernel timer costs a microsecond.  Its signal, SIGALRM, ends the process unless it is handled,
    whatever the library is doing.
    """
    before = signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, *before)


class OpenSocket(NamedTuple):
    """A socket of this process: its descriptor, and the kernel's inode number."""

    descriptor: int
    inode: int


def send_at_once(address: str) -> frozenset[OpenSocket]:
    """Set ``TCP_NODELAY`` on every connection to the robot's RTDE and script ports.

    The library sets it, but then connects in a way that reopens the socket and loses it.  A
    setpoint then waits for the acknowledgement of the previous one.

    Returns:
        These connections, for comparison with later ones.
    """
    found: set[OpenSocket] = set()
    for entry in os.listdir("/proc/self/fd"):  # noqa: PTH208 - names are all that is needed
        # Ignore descriptors that are no sockets or were closed meanwhile.
        with contextlib.suppress(OSError):
            if not str(Path("/proc/self/fd", entry).readlink()).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(entry))) as copy:
                peer = copy.getpeername() if copy.family == socket.AF_INET else ("", 0)
                if peer[0] == address and peer[1] in (RTDE_PORT, SCRIPT_PORT):
                    copy.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    found.add(OpenSocket(int(entry), os.fstat(copy.fileno()).st_ino))
    return frozenset(found)


def are_open(sockets: frozenset[OpenSocket]) -> bool:
    """Whether these are still the same sockets; asks the kernel, a microsecond each."""
    try:
        return all(os.fstat(one.descriptor).st_ino == one.inode for one in sockets)
    except OSError:
        return False


def require_library() -> None:
    """Do nothing if the client library is installed.

    Raises:
        LinkError: it is not.
    """
    if importlib.util.find_spec("rtde_control") is None:
        raise LinkError(f"the driver needs ur-rtde: {sys.executable} -m pip install ur-rtde")


class Link:
    """The receiving and the controlling connection to one robot.

    Args:
        host: the robot's name, for messages.
        registers: registers of the control program, ``lower`` or ``upper``.

    Attributes:
        is_lost: whether the library must no longer be called.
        address: the robot's, resolved before connecting: the library resolves names in calls of
            every cycle.
    """

    def __init__(self, host: str, registers: str = "lower") -> None:
        self.host = host
        self._registers = registers
        self.address = ""
        self.is_lost = False
        self._receive: Any = None
        self._control: Any = None
        self._sockets: frozenset[OpenSocket] = frozenset()

    @property
    def has_control(self) -> bool:
        """Whether the controlling connection exists."""
        return self._control is not None

    def connect(self, address: str) -> None:
        """Open the receiving connection.

        Args:
            address: of the robot, as numbers.

        Raises:
            LinkError: the robot refuses it.
        """
        self.address = address
        module = importlib.import_module("rtde_receive")
        try:
            with process_ends_after(_CONSTRUCTION_LIMIT):
                self._receive = module.RTDEReceiveInterface(address, -1.0, VARIABLES)
        except RuntimeError as error:
            raise LinkError(f"{self.host}: {error}") from error
        _KEPT.append(self._receive)
        self._sockets = send_at_once(self.address)

    def take_control(self) -> None:
        """Open the controlling connection, which uploads the control program and plays it.

        The library clears the command register before it uploads.

        Raises:
            LinkError: another client holds the registers.
            DeviceFaultError: the robot does not accept the program.
        """
        module = importlib.import_module("rtde_control")
        for attempt in range(_REGISTER_RETRIES):
            try:
                with process_ends_after(_CONSTRUCTION_LIMIT):
                    interface = module.RTDEControlInterface
                    flags = interface.FLAG_UPLOAD_SCRIPT
                    if self._registers == "upper":
                        flags |= interface.FLAG_UPPER_RANGE_REGISTERS
                    self._control = interface(self.address, -1.0, flags)
                break
            except RuntimeError as error:
                text = " ".join(str(error).split())
                if "failed to start control script" in text.lower():
                    raise DeviceFaultError(f"{self.host} does not play the control program") from (
                        error
                    )
                if "in use" not in text.lower():
                    raise DeviceFaultError(f"{self.host}: {text}") from error
                if attempt == _REGISTER_RETRIES - 1:
                    other = "lower" if self._registers == "upper" else "upper"
                    raise LinkError(
                        f"another client holds the {self._registers} registers of {self.host}: a "
                        "program with RTDE, or a fieldbus of the installation; end it, or set the "
                        f"option `registers` to {other}"
                    ) from error
                # A controller releases registers a moment after their holder has gone.
                time.sleep(0.1)
        _KEPT.append(self._control)
        self._sockets = send_at_once(self.address)

    def problem(self) -> str:
        """Return why the link counts as lost, or an empty string."""
        if self.is_lost:
            return f"the connection to {self.host} was lost"
        if self._receive is None:
            return f"{self.host} is not connected"
        if not self._receive.isConnected() or (
            self._control is not None and not self._control.isConnected()
        ):
            return f"{self.host} closed the connection"
        return ""

    def require(self) -> None:
        """Do nothing if the link lives.

        Raises:
            SpentLinkError: it no longer does; the library is not called again.
            LinkError: nothing is connected.
        """
        problem = self.problem()
        if problem:
            if self._receive is None:
                raise LinkError(problem)
            self.is_lost = True
            raise SpentLinkError(problem)

    def require_same(self) -> None:
        """Do nothing if the connections are still the original ones.

        Within one slow call, the library may reconnect, and upload and play its program again,
        without a report.  The program then runs without our watchdog, with the arm anywhere.

        Raises:
            LinkError: it has reconnected.
        """
        if not are_open(self._sockets):
            self.is_lost = True
            raise SpentLinkError(f"{self.host} closed the connection, and the library made another")

    # Reports of the controller; called in every cycle.

    def timestamp(self) -> float:
        """Return the controller's time of its newest package, s."""
        return float(self._receive.getTimestamp())

    def modes(self) -> tuple[int, int, int]:
        """Return robot mode, safety mode and runtime state."""
        receive = self._receive
        return (
            int(receive.getRobotMode()),
            int(receive.getSafetyMode()),
            int(receive.getRuntimeState()),
        )

    def motion(self) -> tuple[list[float], list[float], list[float], list[float], float]:
        """Return measured pose and speed, measured and commanded joints, and speed scaling."""
        receive = self._receive
        return (
            receive.getActualTCPPose(),
            receive.getActualTCPSpeed(),
            receive.getActualQ(),
            receive.getTargetQ(),
            receive.getSpeedScaling() * receive.getTargetSpeedFraction(),
        )

    def commanded(self) -> tuple[tuple[float, ...], list[float]]:
        """Return the commanded joint angles and pose."""
        return tuple(self._receive.getTargetQ()), self._receive.getTargetTCPPose()

    # Commands; each checks that the link lives, and each is bounded.

    def tell(self, name: str, *arguments: Any) -> bool:  # noqa: ANN401 - the library's own
        """Call a method of the controlling connection that does not wait for the robot.

        Args:
            name: of the method.
            arguments: its arguments.

        Returns:
            Whether the program accepted it.

        Raises:
            LinkError: the connection is closed.
        """
        try:
            return bool(getattr(self._control, name)(*arguments))
        except RuntimeError as error:
            raise self._loss(error) from error

    def _loss(self, error: RuntimeError) -> SpentLinkError:
        """Return the cause of a failed reconnection, which the library reports once."""
        self.is_lost = True
        return SpentLinkError(f"{self.host} closed the connection: {' '.join(str(error).split())}")

    def order(self, name: str, *arguments: Any, limit: float = _CALL_LIMIT) -> bool:  # noqa: ANN401 - the library's own
        """Call a method of the controlling connection that waits for the robot.

        Args:
            name: of the method.
            arguments: its arguments.
            limit: s after which the process ends.

        Raises:
            LinkError: the link is lost.
            DeviceFaultError: the robot refuses.
        """
        self.require()
        with process_ends_after(limit):
            try:
                return bool(getattr(self._control, name)(*arguments))
            except RuntimeError as error:
                if self.problem():
                    raise self._loss(error) from error
                raise DeviceFaultError(f"{self.host}: {error}") from error

    def clear_command(self) -> None:
        """Clear the command register: the program carries out its content when it is played.

        Raises:
            LinkError: the link is lost.
        """
        # The library writes 0 for this order, whether or not a program plays.
        self.order("kickWatchdog")

    def _require_no_command(self) -> None:
        """Do nothing if the controller reports that the command register is clear.

        Raises:
            LinkError: the controller does not report it.
            DeviceFaultError: the register is not clear.
        """
        register = f"input_int_register_{24 if self._registers == 'upper' else 0}"
        with RtdeClient(self.address, _CLEARED, total=_CLEARED) as client:
            client.subscribe(_REGISTER_RATE, [register])
            ends = time.monotonic() + 0.5 * _CLEARED
            while command := client.sample()[register][0]:
                if time.monotonic() > ends:
                    raise DeviceFaultError(
                        f"{self.host} holds the command {command:g} in {register}, which would "
                        "move the arm; end the program that writes there, then reset"
                    )

    def play(self, timeout: float = 2.0) -> None:
        """Upload the control program again and wait until it plays.

        Raises:
            LinkError: the link is lost.
            DeviceFaultError: the robot does not play it, or holds a command for it.
        """
        self.clear_command()
        self._require_no_command()
        self.order("reuploadScript")
        self._sockets = send_at_once(self.address)
        ends = time.monotonic() + timeout
        while self.modes()[2] != RuntimeState.PLAYING or not self._control.isProgramRunning():
            self.require()
            if time.monotonic() > ends:
                raise DeviceFaultError(
                    f"{self.host} does not play the control program; is it in remote control?"
                )
            time.sleep(0.002)

    def disconnect(self) -> None:
        """End the control program and close the connections, if the link lives.  Never raises."""
        if self.problem():
            return
        try:
            with process_ends_after(_CALL_LIMIT):
                if self._control is not None:
                    self._control.stopScript()
                    self._control.disconnect()
                self._receive.disconnect()
        except RuntimeError:
            # The link was lost just now; do not call any of it again.
            self.is_lost = True
            return
        self._control = self._receive = None
