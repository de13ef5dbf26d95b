"""The emulated controller: its states, its registers, its program and its arm; no sockets here.

:meth:`Controller.tick` advances everything by 2 ms.  Whoever owns the sockets calls it, hands it
what clients wrote, and reads variables by their RTDE names with :meth:`Controller.value`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from emulated_ur.arm import TICK, Arm, Behaviour, Mode, Tool
from emulated_ur.functions import FLAGS, Functions
from emulated_ur.outputs import OUTPUT_GETTERS
from emulated_ur.urscript import Program, Script, ScriptError, compile_script
from emulated_ur.variables import INPUTS, REGISTERS, ProgramState, RobotMode, SafetyMode
from emulated_ur.wire import Value

_STOPPED_BY_SAFETY = frozenset(
    {
        SafetyMode.PROTECTIVE_STOP,
        SafetyMode.SAFEGUARD_STOP,
        SafetyMode.SYSTEM_EMERGENCY_STOP,
        SafetyMode.ROBOT_EMERGENCY_STOP,
        SafetyMode.VIOLATION,
        SafetyMode.FAULT,
        SafetyMode.RECOVERY,
    }
)
_HARD_DECELERATION = 30.0
_SHORTEST_TICKS = 50
"""A program plays at least so long that its client can see it."""

_HISTORY = 2500

Event = tuple[str, int, int, str, str]
"""What the primary interface tells: kind, line, column, title, text."""


class RefusedError(Exception):
    """A request that the robot's present state does not allow; the text is what it answers."""


class Controller:
    """One robot."""

    def __init__(self, behaviour: Behaviour | None = None) -> None:
        self.behaviour = behaviour or Behaviour()
        self.arm = Arm(model=self.behaviour.model)
        self.ticks = 0
        # Clients take a clock that starts at zero for a controller that is still booting.
        self.timestamp = 100.0
        self.robot_mode = RobotMode.RUNNING
        self.safety_status = SafetyMode.NORMAL
        self.runtime_state = ProgramState.STOPPED
        self.is_remote = True
        self.is_touching = False
        self.loaded_program = ""
        self.speed_slider = 1.0
        self.speed_fraction = 1.0
        self.speed_limiter = 1.0
        self.tool = Tool(self.arm)
        self.payload = 0.0
        self.payload_cog: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.payload_inertia: tuple[float, ...] = (0.0,) * 6
        self.gravity: tuple[float, ...] = (0.0, 0.0, 9.82)
        self.digital_inputs = self.digital_outputs = 0
        self.analog_inputs = [0.0] * 4
        self.analog_outputs = [0.0, 0.0]
        self.analog_types = 0
        self.tool_voltage = 0
        self.flags = [False] * FLAGS
        self.external_force: tuple[float, ...] = (0.0,) * 6
        self.uses_external_force = False
        self.input_bits = self.output_bits = 0
        self.input_ints = [0] * REGISTERS
        self.input_doubles = [0.0] * REGISTERS
        self.output_ints = [0] * REGISTERS
        self.output_doubles = [0.0] * REGISTERS
        self.log: list[str] = []
        self.told: deque[str] = deque(maxlen=100)
        self.popup = ""
        self.operational_mode = "NONE"
        self.user_role = "PROGRAMMER"
        self.missing_files: set[str] = set()
        self.events: deque[Event] = deque(maxlen=1000)
        self.history: deque[tuple[float, ...]] = deque([self.arm.actual_q], maxlen=_HISTORY)
        self.on_message: Callable[[str], None] = lambda _text: None
        self.program: Program | None = None
        self.secondary: Program | None = None
        self._next_program: Program | None = None
        self._written: list[tuple[Sequence[str], Sequence[Value]]] = []
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
            for names, values in written:
                self._apply(names, values)
        while self._due and self._due[0][0] <= self.ticks:
            self._due.pop(0)[1]()
        self._move_slider()
        self._run_program()
        breach = self.arm.step(self.speed_scaling)
        if breach is not None and self.behaviour.stops_on_breach and self.is_powered:
            self.protective_stop(str(breach))
        self.history.append(self.arm.actual_q)
        if self.runtime_state is ProgramState.PAUSING and self.arm.is_still:
            self.runtime_state = ProgramState.PAUSED

    def later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call *action* at the first tick after *seconds*."""
        self._due.append((self.ticks + max(1, round(seconds / TICK)), action))
        self._due.sort(key=lambda entry: entry[0])

    @property
    def speed_scaling(self) -> float:
        """How fast a program's time runs: the slider's fraction times what the limiter leaves."""
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
        if self.safety_mode in _STOPPED_BY_SAFETY or self._watchdog_bites():
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
        self.events.append(("exception", error.line, error.column, "", str(error)))

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
        """Whether nothing forbids a program to move the arm."""
        return self.is_powered and self.safety_mode not in _STOPPED_BY_SAFETY

    def upload(self, text: str) -> None:
        """Take a program sent to a script port: a line, ``def .. end`` or ``sec .. end``."""
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

    def _start(self, program: Program) -> None:
        if program is not self._next_program or not self.can_move:
            return
        self._next_program = None
        self._watchdog = None
        self.program = program
        self._playing_since = self.ticks
        self.arm.hold() if self.arm.is_still else self.arm.brake(_HARD_DECELERATION)
        self.runtime_state = ProgramState.PLAYING
        self.events.append(("key", 0, 0, "PROGRAM_XXX_STARTED", program.script.name or "unnamed"))

    def _end_program(self, why: str) -> None:
        if why:
            self.say(why)
        if self.program is not None:
            name = self.program.script.name or "unnamed"
            self.events.append(("key", 0, 0, "PROGRAM_XXX_STOPPED", name))
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
            RefusedError: none plays.
        """
        if self.runtime_state is not ProgramState.PLAYING:
            raise RefusedError("Failed to execute: pause")
        self.runtime_state = ProgramState.PAUSING
        self.arm.brake(_HARD_DECELERATION)

    def play(self) -> None:
        """Play the paused program, or the loaded one.

        Raises:
            RefusedError: there is none, or the robot is stopped.
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
        """``stop`` or ``pause`` the program when *register* is not written so often a second.

        Raises:
            ValueError: there is no such register or action.
        """
        if register not in INPUTS or action not in ("pause", "stop", "ignore"):
            raise ValueError(f"rtde_set_watchdog: no register {register!r} or action {action!r}")
        ticks = max(1, round(1.0 / (max(frequency, 1e-3) * TICK)))
        self._watchdog = None if action == "ignore" else (register, ticks, action)
        self._watchdog_fed = self.ticks

    def say(self, text: str) -> None:
        """Write a line into the log and to the clients."""
        self.log.append(f"{self.timestamp:.3f} {text}")
        self.on_message(text)

    def tell(self, text: str) -> None:
        """Write a program's words into its log and to the clients."""
        self.told.append(text)
        self.events.append(("text", 0, 0, "", text))

    def open_popup(
        self, text: str, title: str, *, warning: bool, error: bool, blocking: bool
    ) -> None:
        """Show a window on the pendant."""
        self.popup = text or title
        self.events.append(("popup", warning, error << 1 | blocking, title, text))

    def close_popup(self) -> None:
        """Close the window on the pendant."""
        self.popup = ""

    @property
    def force(self) -> tuple[float, ...]:
        """The force at the tool; there is none but what a client has written."""
        return self.external_force if self.uses_external_force else (0.0,) * 6

    def push(self, q: Sequence[float], seconds: float) -> None:
        """Let somebody move the joints by hand to *q*, rad, in so many seconds.

        Raises:
            RefusedError: a program holds the arm, or it is still moving.
        """
        is_held = self.runtime_state is ProgramState.PLAYING and self.can_move
        if self.arm.mode is not Mode.FREE and (is_held or not self.arm.is_still):
            raise RefusedError("the arm does not give way: freedrive is off, and nothing stops it")
        self.arm.push(tuple(q), seconds)

    # Safety.

    def protective_stop(self, why: str = "asked for") -> None:
        """Stop the arm until the stop is unlocked."""
        if self.safety_mode in _STOPPED_BY_SAFETY:
            return
        self.say(f"protective stop: {why}")
        self._halt(SafetyMode.PROTECTIVE_STOP)
        leaves = self.behaviour.protective_stop_leaves
        if leaves is ProgramState.STOPPED:
            self._end_program("")
        elif self.runtime_state is ProgramState.PLAYING:
            self.runtime_state = leaves

    @property
    def safety_mode(self) -> SafetyMode:
        """The mode that clients of old know; other safeguards are safeguard stops to them."""
        is_other = self.safety_status > SafetyMode.UNDEFINED_SAFETY_MODE
        return SafetyMode.SAFEGUARD_STOP if is_other else self.safety_status

    def emergency_stop(self, mode: SafetyMode = SafetyMode.ROBOT_EMERGENCY_STOP) -> None:
        """Stop the arm, end the program and cut the power; also for a violation or a fault."""
        self.say(mode.name.lower().replace("_", " "))
        self._halt(mode)
        self._end_program("")
        self.robot_mode = RobotMode.POWER_OFF

    def safeguard_stop(self, mode: SafetyMode = SafetyMode.SAFEGUARD_STOP) -> None:
        """Stop the arm and pause the program until the safeguard is released."""
        if self.safety_mode in _STOPPED_BY_SAFETY:
            return
        self.say(mode.name.lower().replace("_", " "))
        self._halt(mode)
        if self.runtime_state is ProgramState.PLAYING:
            self.runtime_state = ProgramState.PAUSED

    def reduce(self, mode: SafetyMode = SafetyMode.REDUCED) -> None:
        """Enter the reduced or the recovery mode, if the mode is normal."""
        if self.safety_status is SafetyMode.NORMAL:
            self.safety_status = mode
            if mode is SafetyMode.RECOVERY and self.runtime_state is not ProgramState.STOPPED:
                self._end_program("recovery mode")

    def _halt(self, mode: SafetyMode) -> None:
        self.safety_status = mode
        self._stopped_since = self.ticks
        self.arm.brake(_HARD_DECELERATION)

    def release(self) -> None:
        """Let go of a button or a safeguard, or of a mode; a protective stop needs an unlock."""
        latched = (SafetyMode.PROTECTIVE_STOP, SafetyMode.VIOLATION, SafetyMode.FAULT)
        if self.safety_mode not in latched:
            self.safety_status = SafetyMode.NORMAL

    def unlock_protective_stop(self) -> None:
        """Leave a protective stop.

        Raises:
            RefusedError: too early, or the robot is not in one.
        """
        since = (self.ticks - self._stopped_since) * TICK
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP and since < self.behaviour.unlock_after:
            raise RefusedError(
                "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
                "protective stop before unlocking"
            )
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP:
            self.safety_status = SafetyMode.NORMAL

    def restart_safety(self) -> None:
        """Leave a violation or a fault; the arm stays without power."""
        if self.safety_mode in (SafetyMode.VIOLATION, SafetyMode.FAULT):
            self.safety_status = SafetyMode.NORMAL
            self.robot_mode = RobotMode.POWER_OFF

    def power_on(self) -> None:
        """Power the arm; it is idle, brakes on, a moment later."""
        if self.robot_mode is RobotMode.POWER_OFF and self.safety_mode not in _STOPPED_BY_SAFETY:
            self.robot_mode = RobotMode.POWER_ON
            self.later(self.behaviour.power_up, lambda: self._reach(RobotMode.IDLE))

    def power_off(self) -> None:
        """Take the power away; a program ends."""
        if self.runtime_state is not ProgramState.STOPPED:
            self._end_program("power off")
        self.robot_mode = RobotMode.POWER_OFF

    def release_brakes(self) -> None:
        """Release the brakes, powering on first where that is needed."""
        if self.robot_mode is RobotMode.POWER_OFF:
            self.power_on()
            self.later(2.0 * self.behaviour.power_up, lambda: self._reach(RobotMode.RUNNING))
        elif self.robot_mode in (RobotMode.IDLE, RobotMode.POWER_ON):
            self.later(self.behaviour.power_up, lambda: self._reach(RobotMode.RUNNING))

    def _reach(self, mode: RobotMode) -> None:
        if self.robot_mode >= RobotMode.POWER_ON and self.safety_mode not in _STOPPED_BY_SAFETY:
            self.robot_mode = mode

    # Variables.

    def value(self, name: str) -> Value:
        """Return an RTDE output variable by its name."""
        return OUTPUT_GETTERS[name](self)

    def write(self, name: str, value: Value) -> None:
        """Take an RTDE input variable; masks and values of one package are applied in order."""
        if self._watchdog is not None and name == self._watchdog[0]:
            self._watchdog_fed = self.ticks
        if name == "external_force_torque" and isinstance(value, tuple):
            self.external_force = value
        if isinstance(value, tuple):
            return
        if name.startswith("input_int_register_"):
            self.input_ints[int(name[19:])] = int(value)
        elif name.startswith("input_double_register_"):
            self.input_doubles[int(name[22:])] = float(value)
        elif name.startswith("input_bit_register"):
            shift, count = (int(name[19:]), 1) if name[18] == "_" else (32 * ("32" in name), 32)
            mask = (1 << count) - 1
            self.input_bits = self.input_bits & ~(mask << shift) | (int(value) & mask) << shift

    def write_package(self, names: Sequence[str], values: Sequence[Value]) -> None:
        """Take one package of inputs, which a program sees from the next cycle on."""
        if self.behaviour.cycle_ticks == 1:
            self._apply(names, values)
        else:
            self._written.append((names, values))

    def _apply(self, names: Sequence[str], values: Sequence[Value]) -> None:
        for name, value in zip(names, values, strict=True):
            self.write(name, value)
        given = dict(zip(names, values, strict=True))
        if given.get("speed_slider_mask"):
            fraction = given.get("speed_slider_fraction", 1.0)
            self.set_slider(fraction if isinstance(fraction, float) else 1.0)
        for kind, shift in (("standard", 0), ("configurable", 8), ("tool", 16)):
            mask = given.get(f"{kind}_digital_output_mask")
            bits = given.get(f"{kind}_digital_output")
            if isinstance(mask, int) and isinstance(bits, int):
                self.digital_outputs &= ~(mask << shift)
                self.digital_outputs |= (mask & bits) << shift
        analog = given.get("standard_analog_output_mask")
        types = given.get("standard_analog_output_type")
        for port in (0, 1):
            if isinstance(analog, int) and isinstance(types, int) and analog >> port & 1:
                bit = 1 << 2 + port
                self.analog_types = self.analog_types & ~bit | (types >> port & 1) << 2 + port
            level = given.get(f"standard_analog_output_{port}")
            if isinstance(analog, int) and analog & (1 << port) and isinstance(level, float):
                self.analog_outputs[port] = level

    def set_slider(self, fraction: float) -> None:
        """Move the speed slider, 0 to 1."""
        self.speed_slider = max(0.0, min(1.0, fraction))
