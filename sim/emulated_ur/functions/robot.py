"""Functions of URScript that read or set the robot: state, kinematics, I/O, registers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from emulated_ur.arm import TICK, to_pose
from emulated_ur.functions.motions import finite
from emulated_ur.urscript import Array, Datum, Pose, written
from emulated_ur.variables import SafetyMode

if TYPE_CHECKING:
    from emulated_ur.controller import Controller
    from emulated_ur.urscript import Ticks

_Place = Callable[[int], tuple[str, int]]
"""Place of a numbered bit: a variable, and the bit in it."""

_INT32 = 1 << 31
FLAGS = 64
REGISTERS = 48


def _variable(
    name: str, kind: Callable[[Datum], Datum] = lambda found: found
) -> Callable[[Robot], Datum]:
    return lambda self: kind(self.robot.value(name))


def _analog(name: str) -> Callable[[Robot, int], float]:
    return lambda self, n: float(self.robot.variables[f"{name}{_number(n, 2)}"])


def _register(kind: str) -> Callable[[Robot, int], float]:
    name = f"{kind}_register_{{}}"
    return lambda self, address: self.robot.variables[name.format(_number(address, REGISTERS))]


def _set_register(
    kind: str, convert: Callable[[Datum], float]
) -> Callable[[Robot, int, Datum], None]:
    def write(self: Robot, address: int, value: Datum) -> None:
        name = f"output_{kind}_register_{_number(address, REGISTERS)}"
        self.robot.variables[name] = convert(value)

    return write


def _int32(value: Datum) -> int:
    if not -_INT32 <= value < _INT32:
        raise OverflowError(f"{value} is outside an integer register")
    return int(value)


def _accepted(*_: Datum, **__: Datum) -> None:
    """Accept a setting that has no effect on an arm without sensors, fieldbus or cabinet."""


def _digital(kind: str, first: int, count: int) -> _Place:
    return lambda n: (f"actual_digital_{kind}_bits", 1 << first + _number(n, count))


def _bit_register(kind: str) -> _Place:
    def place(n: int) -> tuple[str, int]:
        number = _number(n, 128)
        if number >= 64:
            return f"{kind}_bit_register_{number}", 1
        first = number // 32 * 32
        return f"{kind}_bit_registers{first}_to_{first + 31}", 1 << number % 32

    return place


def _read_bit(place: _Place) -> Callable[[Robot, int], bool]:
    def read(self: Robot, n: int) -> bool:
        name, bit = place(n)
        return bool(self.robot.variables[name] & bit)

    return read


def _write_bit(place: _Place) -> Callable[[Robot, int, bool], None]:
    def write(self: Robot, n: int, b: bool) -> None:
        name, bit = place(n)
        self.robot.set_bits(name, bit, bit if b else 0)

    return write


def _number(n: int, count: int) -> int:
    if not 0 <= n < count:
        raise IndexError(f"number {n} is outside 0 to {count - 1}")
    return int(n)


class Robot:
    """Functions that read or set the robot."""

    robot: Controller

    # State.

    get_actual_joint_positions = get_joint_positions = _variable("actual_q", Array)
    get_actual_joint_speeds = get_joint_speeds = _variable("actual_qd", Array)
    get_target_joint_positions = _variable("target_q", Array)
    get_target_joint_speeds = _variable("target_qd", Array)
    get_target_joint_accelerations = _variable("target_qdd", Array)
    get_tcp_force = _variable("actual_TCP_force", Array)
    get_actual_tcp_pose = _variable("actual_TCP_pose", Pose)
    get_target_tcp_pose = get_target_waypoint = _variable("target_TCP_pose", Pose)
    get_actual_tcp_speed = _variable("actual_TCP_speed", Array)
    get_target_tcp_speed = _variable("target_TCP_speed", Array)
    get_joint_torques = _variable("target_moment", Array)
    get_tool_accelerometer_reading = _variable("actual_tool_accelerometer", Array)
    get_tool_current = _variable("tool_output_current")
    force = _variable("tcp_force_scalar")

    def is_steady(self) -> bool:
        return self.robot.arm.is_still

    def get_actual_joint_positions_history(self, steps: int = 0) -> Array:
        history = self.robot.history
        return Array(history[-1 - _number(steps, len(history))])

    def get_actual_tool_flange_pose(self) -> Pose:
        return Pose(to_pose(self.robot.arm.kinematics.forward(self.robot.arm.actual_q)))

    def get_joint_temp(self, j: int) -> float:
        return 28.0

    def get_controller_temp(self) -> float:
        return 28.0

    def get_steptime(self) -> float:
        return TICK * self.robot.behaviour.cycle_ticks

    def get_freedrive_status(self) -> int:
        return 0

    # Kinematics.

    def get_forward_kin(self, q: Datum = None, tcp: Datum = None) -> Pose:
        joints = self.robot.arm.actual_q if q is None else finite(q)
        return Pose(to_pose(self.robot.tool.at(joints, None if tcp is None else finite(tcp))))

    def get_inverse_kin(
        self, x: Datum, qnear: Datum = None, maxPositionError: float = 0.0,
        maxOrientationError: float = 0.0, tcp: Datum = None,
    ) -> Array:  # fmt: skip
        near = None if qnear is None else finite(qnear)
        return Array(
            self.robot.tool.joints_at(finite(x), near, None if tcp is None else finite(tcp))
        )

    def get_inverse_kin_has_solution(
        self, pose: Datum, qnear: Datum = None, maxPositionError: float = 0.0,
        maxOrientationError: float = 0.0, tcp: Datum = None,
    ) -> bool:  # fmt: skip
        near = None if qnear is None else finite(qnear)
        offset = None if tcp is None else finite(tcp)
        return self.robot.tool.find_joints(finite(pose), near, offset) is not None

    def is_within_safety_limits(self, pose: Datum) -> bool:
        if isinstance(pose, Pose):
            return self.get_inverse_kin_has_solution(pose)
        ranges = self.robot.arm.model.ranges
        return all(abs(q) <= most for q, most in zip(finite(pose), ranges, strict=True))

    # Tool and safety.

    get_tcp_offset = _variable("tcp_offset", Pose)
    get_target_payload = _variable("payload")
    get_target_payload_cog = _variable("payload_cog", Array)
    get_target_payload_inertia = _variable("payload_inertia", Array)

    def set_tcp(self, pose: Datum, tcp_name: str = "") -> None:
        self.robot.tool.offset = finite(pose)

    def set_payload(self, m: float, cog: Datum = None) -> None:
        self.set_target_payload(m, self.robot.variables["payload_cog"] if cog is None else cog)

    def set_payload_mass(self, m: float) -> None:
        self.set_payload(m)

    def set_payload_cog(self, cog: Datum) -> None:
        self.set_payload(self.robot.variables["payload"], cog)

    def set_target_payload(
        self, m: float, cog: Datum, inertia: Datum = None, transition_time: float = 0.0
    ) -> None:
        variables = self.robot.variables
        (variables["payload"],) = finite((m,), 1)
        variables["payload_cog"] = finite(cog, 3)
        if inertia is not None:
            variables["payload_inertia"] = finite(inertia)

    def set_gravity(self, d: Datum) -> None:
        self.robot.gravity = finite(d, 3)

    def protective_stop(self) -> None:
        self.robot.enter(SafetyMode.PROTECTIVE_STOP, "asked for by the program")

    def powerdown(self) -> None:
        self.robot.power_off()

    def rtde_set_watchdog(
        self, variable_name: str, min_frequency: float, action: str = "pause"
    ) -> None:
        self.robot.set_watchdog(variable_name, min_frequency, action)

    def ft_rtde_input_enable(
        self, enable: bool, sensor_mass: float = 0.0, sensor_measuring_offset: Datum = (),
        sensor_cog: Datum = (),
    ) -> None:  # fmt: skip
        self.robot.uses_external_force = bool(enable)

    enable_external_ft_sensor = ft_rtde_input_enable
    zero_ftsensor = force_mode_set_damping = force_mode_set_gain_scaling = _accepted
    set_tool_communication = set_safety_mode_transition_hardness = _accepted
    set_standard_analog_input_domain = set_tool_analog_input_domain = _accepted
    set_tool_output_mode = set_tool_digital_output_mode = set_analog_inputrange = _accepted
    set_digital_output_safe_state = set_input_actions_to_default = _accepted

    # Inputs and outputs.

    set_digital_out = _write_bit(_digital("output", 0, 10))
    set_standard_digital_out = _write_bit(_digital("output", 0, 8))
    set_configurable_digital_out = _write_bit(_digital("output", 8, 8))
    set_tool_digital_out = _write_bit(_digital("output", 16, 2))
    get_digital_out = _read_bit(_digital("output", 0, 10))
    get_standard_digital_out = _read_bit(_digital("output", 0, 8))
    get_configurable_digital_out = _read_bit(_digital("output", 8, 8))
    get_tool_digital_out = _read_bit(_digital("output", 16, 2))
    get_digital_in = _read_bit(_digital("input", 0, 10))
    get_standard_digital_in = _read_bit(_digital("input", 0, 8))
    get_configurable_digital_in = _read_bit(_digital("input", 8, 8))
    get_tool_digital_in = _read_bit(_digital("input", 16, 2))
    get_analog_in = get_standard_analog_in = _analog("standard_analog_input")
    get_tool_analog_in = _analog("tool_analog_input")
    get_analog_out = get_standard_analog_out = _analog("standard_analog_output")

    def set_analog_out(self, n: int, f: float) -> None:
        self.robot.set_analog_output(_number(n, 2), f)

    set_standard_analog_out = set_analog_out

    def set_analog_outputdomain(self, port: int, domain: int) -> None:
        bit = 1 << 2 + _number(port, 2)
        self.robot.set_bits("analog_io_types", bit, bit if domain else 0)

    def set_tool_voltage(self, voltage: int) -> None:
        if voltage not in (0, 12, 24):
            raise ValueError(f"a tool voltage is 0, 12 or 24, got {voltage}")
        self.robot.variables["tool_output_voltage"] = int(voltage)

    def set_flag(self, n: int, b: bool) -> None:
        self.robot.flags[_number(n, FLAGS)] = bool(b)

    def get_flag(self, n: int) -> bool:
        return self.robot.flags[_number(n, FLAGS)]

    # Registers.

    read_input_integer_register = _register("input_int")
    read_input_float_register = _register("input_double")
    read_input_boolean_register = _read_bit(_bit_register("input"))
    read_output_integer_register = _register("output_int")
    read_output_float_register = _register("output_double")
    read_output_boolean_register = _read_bit(_bit_register("output"))
    write_output_integer_register = _set_register("int", _int32)
    write_output_float_register = _set_register("double", float)
    write_output_boolean_register = _write_bit(_bit_register("output"))

    # Words.

    def textmsg(self, s1: Datum, s2: Datum = "") -> None:
        self.robot.tell(written(s1) + written(s2))

    def popup(
        self, s: Datum, title: str = "Popup", warning: bool = False, error: bool = False,
        blocking: bool = False,
    ) -> Ticks:  # fmt: skip
        self.robot.open_popup(written(s), title, warning, error, blocking)
        while blocking and self.robot.popup:
            yield
