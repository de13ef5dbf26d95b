"""The emulated controller: its states, its variables, its program and its arm; no sockets here.

:meth:`Controller.tick` advances everything by 2 ms.  The owner of the sockets calls it, passes in
the clients' bytes, and reads variables by their RTDE names with :meth:`Controller.value`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

from emulated_ur.arm import TICK, Arm, Behaviour, Mode, Tool
from emulated_ur.functions import FLAGS, Functions
from emulated_ur.outputs import COMPUTED
from emulated_ur.urscript import Program, Script, ScriptError, compile_script
from emulated_ur.variables import VARIABLES, ProgramState, RobotMode, SafetyMode, Value

_HARD_DECELERATION = 30.0
_SHORTEST_TICKS = 50
"""Least duration of a program, so that its client sees it play."""

_HISTORY = 2500


class Severity(IntEnum):
    """The effect of a safety mode; a mode yields to those with a stronger effect."""

    NONE = 0
    RESTRICTS = 1
    STOPS = 2
    CUTS_POWER = 3


class Safety(NamedTuple):
    """One safety mode: its effect, the program after it, and ``safety_status_bits``."""

    severity: Severity
    program: ProgramState | None
    bits: int
    is_latched: bool = False

    @property
    def forbids_motion(self) -> bool:
        """Whether the arm must not move."""
        return self.severity >= Severity.STOPS or self.program is ProgramState.STOPPED


_STOPPED = 1 << 10
_SAFEGUARD = Safety(Severity.STOPS, ProgramState.PAUSED, 1 << 4 | _STOPPED)
_SAFETY = {
    SafetyMode.NORMAL: Safety(Severity.NONE, None, 1 << 0),
    SafetyMode.REDUCED: Safety(Severity.RESTRICTS, None, 1 << 0 | 1 << 1),
    # The state of the program afterwards is part of the robot's behaviour.
    SafetyMode.PROTECTIVE_STOP: Safety(Severity.STOPS, None, 1 << 2 | _STOPPED, is_latched=True),
    SafetyMode.RECOVERY: Safety(Severity.RESTRICTS, ProgramState.STOPPED, 1 << 3),
    SafetyMode.SAFEGUARD_STOP: _SAFEGUARD,
    SafetyMode.AUTOMATIC_MODE_SAFEGUARD_STOP: _SAFEGUARD,
    SafetyMode.SYSTEM_THREE_POSITION_ENABLING_STOP: _SAFEGUARD,
    **{
        mode: Safety(Severity.CUTS_POWER, ProgramState.STOPPED, bits | _STOPPED, is_latched)
        for mode, bits, is_latched in (
            (SafetyMode.SYSTEM_EMERGENCY_STOP, 1 << 5 | 1 << 7, False),
            (SafetyMode.ROBOT_EMERGENCY_STOP, 1 << 6 | 1 << 7, False),
            (SafetyMode.VIOLATION, 1 << 8, True),
            (SafetyMode.FAULT, 1 << 9, True),
        )
    },
}


class Event(NamedTuple):
    """A message to clients: its kind, text and title, and the numbers of its kind.

    The kinds are ``log``, ``text``, ``key``, ``popup`` (warning, error, blocking) and
    ``exception`` (line, column).
    """

    kind: str
    text: str
    title: str = ""
    numbers: tuple[int, ...] = ()


class RefusedError(Exception):
    """A request that the robot's present state does not allow; the text is its answer."""


class Controller:
    """One robot."""

    def __init__(self, behaviour: Behaviour | None = None) -> None:
        self.behaviour = behaviour or Behaviour()
        self.arm = Arm(model=self.behaviour.model, smooths_servo=self.behaviour.smooths_servo)
        self.ticks = 0
        # Clients mistake a clock that starts at zero for a controller that is still booting.
        self.timestamp = 100.0
        self.variables: dict[str, Any] = {n: one.initial for n, one in VARIABLES.items()}
        self.robot_mode: RobotMode = RobotMode.RUNNING
        self.safety_status: SafetyMode = SafetyMode.NORMAL
        self.runtime_state = ProgramState.STOPPED
        self.is_remote = True
        self.is_touching = False
        self.loaded_program = ""
        self.speed_slider = 1.0
        self.speed_fraction = 1.0
        self.speed_limiter = 1.0
        self.tool = Tool(self.arm)
        self.gravity: tuple[float, ...] = (0.0, 0.0, 9.82)
        self.flags = [False] * FLAGS
        self.uses_external_force = False
        self.log: list[str] = []
        self.told: deque[str] = deque(maxlen=100)
        self.popup = ""
        self.operational_mode = "NONE"
        self.user_role = "PROGRAMMER"
        self.missing_files: set[str] = set()
        self.events: deque[Event] = deque(maxlen=1000)
        self.history: deque[tuple[float, ...]] = deque([self.arm.actual_q], maxlen=_HISTORY)
        self.program: Program | None = None
        self.secondary: Program | None = None
        self._next_program: Program | None = None
        self._written: list[dict[str, Any]] = []
        self._due: list[tuple[int, Callable[[], None]]] = []
        self._watchdog: tuple[str, int, str] | None = None
        self._watchdog_fed = 0
        self._stopped_since = 0
        self._playing_since = 0
        self._compiled: dict[str, Script] = {}

    # The cycle.

    def tick(self) -> None:
        """Advance by 2 ms."""
        self.ticks += 1
        self.timestamp += TICK
        self.tool.forget_poses()
        if self.ticks % self.behaviour.cycle_ticks == 0:
            written, self._written = self._written, []
            for given in written:
                self._apply(given)
        while self._due and self._due[0][0] <= self.ticks:
            self._due.pop(0)[1]()
        self._move_slider()
        self._run_program()
        breach = self.arm.step(self.speed_scaling)
        if breach is not None and self.behaviour.stops_on_breach and self.is_powered:
            self.enter(SafetyMode.PROTECTIVE_STOP, str(breach))
        self.history.append(self.arm.actual_q)
        if self.runtime_state is ProgramState.PAUSING and self.arm.is_still:
            self.runtime_state = ProgramState.PAUSED

    def later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call *action* at the first tick after *seconds*."""
        self._due.append((self.ticks + max(1, round(seconds / TICK)), action))
        self._due.sort(key=lambda entry: entry[0])

    @property
    def speed_scaling(self) -> float:
        """Speed of a program's time: the slider's fraction times the limiter's."""
        return self.speed_fraction * self.speed_limiter

    def _move_slider(self) -> None:
        # A full change of the slider takes half a second.
        step = TICK / 0.5
        change = self.speed_slider - self.speed_fraction
        self.speed_fraction += max(-step, min(step, change))

    def _run_program(self) -> None:
        if self.secondary is not None and self._has_ended(self.secondary):
            self.secondary.end()
            self.secondary = None
        if self.program is None or self.runtime_state is not ProgramState.PLAYING:
            return
        if self.safety.forbids_motion or self._watchdog_bites():
            return
        if self._has_ended(self.program):
            self._end_program("")

    def _has_ended(self, program: Program) -> bool:
        """Run a program for one cycle."""
        try:
            goes_on = program.advance()
        except ScriptError as error:
            self._report("program ended", error)
            return True
        is_seen = program is self.secondary or self.ticks - self._playing_since >= _SHORTEST_TICKS
        return not goes_on and is_seen

    def _report(self, what: str, error: ScriptError) -> None:
        place = f" (line {error.line})" if error.line else ""
        self.say(f"{what}: {error}{place}")
        self.events.append(Event("exception", str(error), numbers=(error.line, error.column)))

    def _watchdog_bites(self) -> bool:
        if self._watchdog is None or self.ticks - self._watchdog_fed <= self._watchdog[1]:
            return False
        if self._watchdog[2] == "stop":
            self._end_program("watchdog: no input in time")
        else:
            self.say("watchdog: no input in time")
            self._watchdog = None
            self.pause()
        return True

    # Programs.

    @property
    def is_powered(self) -> bool:
        """Whether the brakes are off and the arm may move."""
        return self.robot_mode is RobotMode.RUNNING

    @property
    def can_move(self) -> bool:
        """Whether a program may move the arm."""
        return self.is_powered and not self.safety.forbids_motion

    def upload(self, text: str) -> None:
        """Run a program sent to a script port: a line, ``def .. end`` or ``sec .. end``."""
        functions = Functions(self)
        try:
            script = self._compiled.get(text) or compile_script(text, functions.table())
            program = Program(script, functions)
        except ScriptError as error:
            self._report("program refused", error)
            return
        self._compiled = {**dict(list(self._compiled.items())[-7:]), text: script}
        if not self.is_remote or not (self.can_move or script.is_secondary):
            self.say("program refused: not in remote control, or stopped")
            return
        if script.is_secondary:
            self.secondary = program
            return
        if self.program is not None:
            self._end_program("replaced by another program")
        self._next_program = program
        self.later(self.behaviour.program_start, lambda: self._start(program))

    def interpret(self, line: str) -> str:
        """Run a line that a client sent to interpreter mode; return the answer."""
        if self.program is None:
            return f"discard: no program runs: {line.strip()}"
        return self.program.functions.interpret(line.strip())

    def _start(self, program: Program) -> None:
        if program is not self._next_program or not self.can_move:
            return
        self._next_program = None
        self._watchdog = None
        self.program = program
        self._playing_since = self.ticks
        self.arm.hold() if self.arm.is_still else self.arm.brake(_HARD_DECELERATION)
        self.runtime_state = ProgramState.PLAYING
        self.events.append(Event("key", program.script.name or "unnamed", "PROGRAM_XXX_STARTED"))

    def _end_program(self, why: str) -> None:
        if why:
            self.say(why)
        if self.program is not None:
            name = self.program.script.name or "unnamed"
            self.events.append(Event("key", name, "PROGRAM_XXX_STOPPED"))
            self.program.end()
        self.program = None
        self._watchdog = None
        self.runtime_state = ProgramState.STOPPED
        if self.arm.mode is not Mode.HOLD:
            self.arm.brake(_HARD_DECELERATION)

    def stop(self) -> None:
        """End the program, as the stop button does."""
        self._next_program = None
        if self.runtime_state is not ProgramState.STOPPED:
            self._end_program("program stopped")

    def pause(self) -> None:
        """Pause the program.

        Raises:
            RefusedError: no program plays.
        """
        if self.runtime_state is not ProgramState.PLAYING:
            raise RefusedError("Failed to execute: pause")
        self.runtime_state = ProgramState.PAUSING
        self.arm.brake(_HARD_DECELERATION)

    def play(self) -> None:
        """Play the paused program, or the loaded one.

        Raises:
            RefusedError: there is no program, or the robot is stopped.
        """
        if not self.can_move:
            raise RefusedError("Failed to execute: play")
        if self.runtime_state in (ProgramState.PAUSED, ProgramState.PAUSING) and self.program:
            self._watchdog_fed = self.ticks
            self.runtime_state = ProgramState.PLAYING
        elif self.loaded_program and self.runtime_state is ProgramState.STOPPED:
            functions = Functions(self)
            waiting = compile_script("while True:\n  sync()\nend\n", functions.table())
            self._next_program = Program(waiting, functions)
            self._start(self._next_program)
        else:
            raise RefusedError("Failed to execute: play")

    def set_watchdog(self, register: str, frequency: float, action: str) -> None:
        """``stop`` or ``pause`` the program if *register* is not written at this rate, Hz.

        Raises:
            ValueError: the register or action does not exist.
        """
        is_input = register in VARIABLES and VARIABLES[register].is_input
        if not is_input or action not in ("pause", "stop", "ignore"):
            raise ValueError(f"rtde_set_watchdog: no register {register!r} or action {action!r}")
        ticks = max(1, round(1.0 / (max(frequency, 1e-3) * TICK)))
        self._watchdog = None if action == "ignore" else (register, ticks, action)
        self._watchdog_fed = self.ticks

    def say(self, text: str) -> None:
        """Write a line to the log and to the clients."""
        self.log.append(f"{self.timestamp:.3f} {text}")
        self.events.append(Event("log", text))

    def tell(self, text: str) -> None:
        """Write a program's text to its log and to the clients."""
        self.told.append(text)
        self.events.append(Event("text", text))

    def open_popup(self, text: str, title: str, *flags: bool) -> None:
        """Show a window on the pendant; *flags* tell whether it warns, is an error, and blocks."""
        self.popup = text or title
        self.events.append(Event("popup", text, title, flags))

    def close_popup(self) -> None:
        """Close the window on the pendant."""
        self.popup = ""

    @property
    def force(self) -> tuple[float, ...]:
        """The force at the tool, which is zero unless a client has written one."""
        written: tuple[float, ...] = self.variables["external_force_torque"]
        return written if self.uses_external_force else (0.0,) * 6

    def push(self, q: Sequence[float], seconds: float) -> None:
        """Let a person move the joints by hand to *q*, rad, in a number of seconds.

        Raises:
            RefusedError: a program controls the arm, or it is still moving.
        """
        is_held = self.runtime_state is ProgramState.PLAYING and self.can_move
        if self.arm.mode is not Mode.FREE and (is_held or not self.arm.is_still):
            raise RefusedError("the arm does not give way: freedrive is off, and nothing stops it")
        self.arm.push(tuple(q), seconds)

    # Safety.

    @property
    def safety_mode(self) -> SafetyMode:
        """The mode for older clients; to them, newer safeguards are safeguard stops."""
        is_other = self.safety_status > SafetyMode.UNDEFINED_SAFETY_MODE
        return SafetyMode.SAFEGUARD_STOP if is_other else self.safety_status

    @property
    def safety(self) -> Safety:
        """The effect of the present safety mode."""
        return _SAFETY[self.safety_status]

    def enter(self, mode: SafetyMode, why: str = "") -> None:
        """Enter a safety mode, unless the present one is as severe; stop what it stops."""
        after = _SAFETY[mode]
        if after.severity <= self.safety.severity:
            return
        self.say(mode.name.lower().replace("_", " ") + (f": {why}" if why else ""))
        self.safety_status = mode
        self._stopped_since = self.ticks
        program = after.program
        if mode is SafetyMode.PROTECTIVE_STOP:
            program = self.behaviour.protective_stop_leaves
        if after.severity >= Severity.STOPS:
            self.arm.brake(_HARD_DECELERATION)
        if program is ProgramState.STOPPED and self.runtime_state is not ProgramState.STOPPED:
            self._end_program("")
        elif program and self.runtime_state is ProgramState.PLAYING:
            self.runtime_state = program
        if after.severity is Severity.CUTS_POWER:
            self.robot_mode = RobotMode.POWER_OFF

    def release(self) -> None:
        """Release a button, a safeguard, or a mode; a protective stop needs an unlock."""
        if not self.safety.is_latched:
            self.safety_status = SafetyMode.NORMAL

    def unlock_protective_stop(self) -> None:
        """Leave a protective stop.

        Raises:
            RefusedError: too early, or the robot is not in one.
        """
        since = (self.ticks - self._stopped_since) * TICK
        if self.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            return
        if since < self.behaviour.unlock_after:
            raise RefusedError(
                "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
                "protective stop before unlocking"
            )
        self.safety_status = SafetyMode.NORMAL

    def restart_safety(self) -> None:
        """Leave a violation or a fault; the arm stays without power."""
        if self.safety_mode in (SafetyMode.VIOLATION, SafetyMode.FAULT):
            self.safety_status = SafetyMode.NORMAL
            self.robot_mode = RobotMode.POWER_OFF

    def power_on(self) -> None:
        """Power the arm; shortly after, it is idle with its brakes on."""
        if self.robot_mode is RobotMode.POWER_OFF and not self.safety.forbids_motion:
            self.robot_mode = RobotMode.POWER_ON
            self.later(self.behaviour.power_up, lambda: self._reach(RobotMode.IDLE))

    def power_off(self) -> None:
        """Switch the power off, which ends a program."""
        if self.runtime_state is not ProgramState.STOPPED:
            self._end_program("power off")
        self.robot_mode = RobotMode.POWER_OFF

    def release_brakes(self) -> None:
        """Release the brakes, after powering on if necessary."""
        if self.robot_mode is RobotMode.POWER_OFF:
            self.power_on()
            self.later(2.0 * self.behaviour.power_up, lambda: self._reach(RobotMode.RUNNING))
        elif self.robot_mode in (RobotMode.IDLE, RobotMode.POWER_ON):
            self.later(self.behaviour.power_up, lambda: self._reach(RobotMode.RUNNING))

    def _reach(self, mode: RobotMode) -> None:
        if self.robot_mode >= RobotMode.POWER_ON and not self.safety.forbids_motion:
            self.robot_mode = mode

    # Variables.

    def value(self, name: str) -> Value:
        """Return an RTDE variable by its name."""
        compute = COMPUTED.get(name)
        found: Value = compute(self) if compute else self.variables[name]
        return found

    def set_bits(self, name: str, mask: int, bits: int) -> None:
        """Set the bits of a variable that are in *mask*."""
        self.variables[name] = self.variables[name] & ~mask | bits & mask

    def set_analog_output(self, port: int, share: float) -> None:
        """Set output 0 or 1 to a share of its range: 4 to 20 mA, or 0 to 10 V."""
        is_voltage = self.variables["analog_io_types"] >> 2 + port & 1
        level = 10.0 * share if is_voltage else 0.004 + 0.016 * share
        self.variables[f"standard_analog_output{port}"] = level

    def set_slider(self, fraction: float) -> None:
        """Move the speed slider, 0 to 1."""
        self.speed_slider = max(0.0, min(1.0, fraction))

    def write_package(self, names: Sequence[str], values: Sequence[Value]) -> None:
        """Receive one package of inputs, which a program sees from the next cycle on."""
        given = dict(zip(names, values, strict=True))
        if self.behaviour.cycle_ticks == 1:
            self._apply(given)
        else:
            self._written.append(given)

    def _apply(self, given: dict[str, Any]) -> None:
        self.variables |= given
        if self._watchdog is not None and self._watchdog[0] in given:
            self._watchdog_fed = self.ticks
        if given.get("speed_slider_mask"):
            self.set_slider(given.get("speed_slider_fraction", 1.0))
        for kind, shift in (("standard", 0), ("configurable", 8), ("tool", 16)):
            if (bits := given.get(f"{kind}_digital_output")) is not None:
                mask = given.get(f"{kind}_digital_output_mask", 0)
                self.set_bits("actual_digital_output_bits", mask << shift, bits << shift)
        mask = given.get("standard_analog_output_mask", 0)
        if (types := given.get("standard_analog_output_type")) is not None:
            self.set_bits("analog_io_types", mask << 2, types << 2)
        for port in (0, 1):
            if mask >> port & 1 and f"standard_analog_output_{port}" in given:
                self.set_analog_output(port, given[f"standard_analog_output_{port}"])
