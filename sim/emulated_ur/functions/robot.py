"""Functions of URScript that ask the robot or set something: state, kinematics, I/O, registers."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING

from emulated_ur.arm import TICK, to_pose
from emulated_ur.functions.motions import finite
from emulated_ur.urscript import Array, Datum, Pose, written

if TYPE_CHECKING:
    from emulated_ur.controller import Controller
    from emulated_ur.urscript import Ticks

_INT32 = 1 << 31
FLAGS = 64


def _of(path: str, kind: Callable[[Datum], Datum] = lambda found: found) -> Callable[..., Datum]:
    read = attrgetter(path)
    return lambda self: kind(read(self.robot))


def _tool(name: str, kind: Callable[[Datum], Datum] = Pose) -> Callable[[Robot], Datum]:
    return lambda self: kind(self.robot.tool.pose(name))


def _analog(kind: str, first: int = 0) -> Callable[[Robot, int], float]:
    return lambda self, n: float(getattr(self.robot, kind)[first + _number(n, 2)])


def _register(kind: str) -> Callable[[Robot, int], float]:
    def read(self: Robot, address: int) -> float:
        registers: list[float] = getattr(self.robot, kind)
        return registers[_number(address, len(registers))]

    return read


def _accepted(*_: Datum, **__: Datum) -> None:
    """Take what makes no difference to an arm without sensors, fieldbus or cabinet."""


def _digital_out(first: int, count: int) -> Callable[[Robot, int, bool], None]:
    def set_output(self: Robot, n: int, b: bool) -> None:
        bit = 1 << first + _number(n, count)
        outputs = self.robot.digital_outputs & ~bit
        self.robot.digital_outputs = outputs | bit if b else outputs

    return set_output


def _digital(kind: str, first: int, count: int) -> Callable[[Robot, int], bool]:
    return lambda self, n: bool(getattr(self.robot, kind) >> first + _number(n, count) & 1)


def _analog_out(self: Robot, n: int, f: float) -> None:
    """Set an output to a share of its range: 4 to 20 mA, or 0 to 10 V."""
    at = _number(n, 2)
    is_voltage = self.robot.analog_types >> 2 + at & 1
    self.robot.analog_outputs[at] = 10.0 * f if is_voltage else 0.004 + 0.016 * f


def _number(n: int, count: int) -> int:
    if not 0 <= n < count:
        raise IndexError(f"number {n} is outside 0 to {count - 1}")
    return int(n)


class Robot:
    """What asks the robot, or sets something of it."""

    robot: Controller

    # State.

    get_actual_joint_positions = get_joint_positions = _of("arm.actual_q", Array)
    get_actual_joint_speeds = get_joint_speeds = _of("arm.actual_qd", Array)
    get_target_joint_positions = _of("arm.target_q", Array)
    get_target_joint_speeds = _of("arm.target_qd", Array)
    get_tcp_force = _of("force", Array)
    is_steady = _of("arm.is_still")
    get_target_joint_accelerations = _of("arm.target_qdd", Array)
    get_actual_tcp_pose = _tool("actual_TCP_pose")
    get_target_tcp_pose = get_target_waypoint = _tool("target_TCP_pose")
    get_actual_tcp_speed = _tool("actual_TCP_speed", Array)
    get_target_tcp_speed = _tool("target_TCP_speed", Array)

    def get_actual_joint_positions_history(self, steps: int = 0) -> Array:
        history = self.robot.history
        return Array(history[-1 - _number(steps, len(history))])

    def get_actual_tool_flange_pose(self) -> Pose:
        return Pose(to_pose(self.robot.arm.kinematics.forward(self.robot.arm.actual_q)))

    def get_joint_torques(self) -> Array:
        return Array((0.0,) * 6)

    def get_joint_temp(self, j: int) -> float:
        return 28.0

    def get_controller_temp(self) -> float:
        return 28.0

    def force(self) -> float:
        x, y, z = self.robot.force[:3]
        return float((x * x + y * y + z * z) ** 0.5)

    def get_tool_accelerometer_reading(self) -> Array:
        return Array((0.0, 0.0, -9.82))

    def get_tool_current(self) -> float:
        return 0.0

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

    get_tcp_offset = _of("tool.offset", Pose)
    get_target_payload = _of("payload")
    get_target_payload_cog = _of("payload_cog", Array)
    get_target_payload_inertia = _of("payload_inertia", Array)

    def set_tcp(self, pose: Datum, tcp_name: str = "") -> None:
        self.robot.tool.offset = finite(pose)

    def set_payload(self, m: float, cog: Datum = None) -> None:
        self.set_target_payload(m, self.robot.payload_cog if cog is None else cog)

    def set_payload_mass(self, m: float) -> None:
        self.set_payload(m)

    def set_payload_cog(self, cog: Datum) -> None:
        self.set_payload(self.robot.payload, cog)

    def set_target_payload(
        self, m: float, cog: Datum, inertia: Datum = None, transition_time: float = 0.0
    ) -> None:
        (self.robot.payload,) = finite((m,), 1)
        self.robot.payload_cog = finite(cog, 3)
        if inertia is not None:
            self.robot.payload_inertia = finite(inertia)

    def set_gravity(self, d: Datum) -> None:
        self.robot.gravity = finite(d, 3)

    def protective_stop(self) -> None:
        self.robot.protective_stop("asked for by the program")

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

    set_digital_out = _digital_out(0, 10)
    set_standard_digital_out = _digital_out(0, 8)
    set_configurable_digital_out = _digital_out(8, 8)
    set_tool_digital_out = _digital_out(16, 2)
    get_digital_out = _digital("digital_outputs", 0, 10)
    get_standard_digital_out = _digital("digital_outputs", 0, 8)
    get_configurable_digital_out = _digital("digital_outputs", 8, 8)
    get_tool_digital_out = _digital("digital_outputs", 16, 2)
    get_digital_in = _digital("digital_inputs", 0, 10)
    get_standard_digital_in = _digital("digital_inputs", 0, 8)
    get_configurable_digital_in = _digital("digital_inputs", 8, 8)
    get_tool_digital_in = _digital("digital_inputs", 16, 2)
    set_analog_out = set_standard_analog_out = _analog_out
    get_analog_in = get_standard_analog_in = _analog("analog_inputs")
    get_tool_analog_in = _analog("analog_inputs", 2)
    get_analog_out = get_standard_analog_out = _analog("analog_outputs")

    def set_analog_outputdomain(self, port: int, domain: int) -> None:
        bit = 1 << 2 + _number(port, 2)
        types = self.robot.analog_types & ~bit
        self.robot.analog_types = types | bit if domain else types

    def set_tool_voltage(self, voltage: int) -> None:
        if voltage not in (0, 12, 24):
            raise ValueError(f"a tool voltage is 0, 12 or 24, got {voltage}")
        self.robot.tool_voltage = int(voltage)

    def set_flag(self, n: int, b: bool) -> None:
        self.robot.flags[_number(n, FLAGS)] = bool(b)

    def get_flag(self, n: int) -> bool:
        return self.robot.flags[_number(n, FLAGS)]

    # Registers.

    read_input_integer_register = _register("input_ints")
    read_input_float_register = _register("input_doubles")
    read_input_boolean_register = _digital("input_bits", 0, 128)
    read_output_integer_register = _register("output_ints")
    read_output_float_register = _register("output_doubles")
    read_output_boolean_register = _digital("output_bits", 0, 128)

    def write_output_integer_register(self, address: int, value: int) -> None:
        if not -_INT32 <= value < _INT32:
            raise OverflowError(f"{value} is outside an integer register")
        self.robot.output_ints[_number(address, len(self.robot.output_ints))] = int(value)

    def write_output_float_register(self, address: int, value: float) -> None:
        self.robot.output_doubles[_number(address, len(self.robot.output_doubles))] = float(value)

    def write_output_boolean_register(self, address: int, value: bool) -> None:
        bit = 1 << _number(address, 128)
        bits = self.robot.output_bits & ~bit
        self.robot.output_bits = bits | bit if value else bits

    # Words.

    def textmsg(self, s1: Datum, s2: Datum = "") -> None:
        self.robot.tell(written(s1) + written(s2))

    def popup(
        self, s: Datum, title: str = "Popup", warning: bool = False, error: bool = False,
        blocking: bool = False,
    ) -> Ticks:  # fmt: skip
        self.robot.open_popup(written(s), title, warning=warning, error=error, blocking=blocking)
        while blocking and self.robot.popup:
            yield
