"""The functions that a controller offers to its programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from emulated_ur.functions.interpreter import Interpreter
from emulated_ur.functions.motions import Motions
from emulated_ur.functions.robot import FLAGS, Robot
from emulated_ur.functions.sockets import Sockets
from emulated_ur.functions.values import Values
from emulated_ur.urscript import ScriptError

if TYPE_CHECKING:
    from emulated_ur.controller import Controller

_NOT_EMULATED = """
    conveyor_pulse_decode direct_torque encoder_enable_pulse_decode
    encoder_enable_set_tick_count encoder_get_tick_count encoder_set_tick_count
    encoder_unwind_delta_tick_count end_screw_driving eval get_conveyor_tick_count
    get_coriolis_and_centrifugal_torques get_jacobian get_jacobian_time_derivative
    get_mass_matrix modbus_add_signal
    modbus_delete_signal modbus_get_signal_status modbus_send_custom_command
    modbus_set_digital_input_action modbus_set_output_register modbus_set_output_signal
    modbus_set_signal_update_frequency optimovej optimovel path_offset_disable
    path_offset_enable path_offset_get path_offset_set path_offset_set_alpha_filter
    path_offset_set_max_offset read_port_bit read_port_register
    request_boolean_from_primary_client request_float_from_primary_client
    request_integer_from_primary_client request_string_from_primary_client
    reset_revolution_counter rpc_factory screw_driving set_conveyor_tick_count
    set_runstate_outputs set_tool_wrench_limits struct tool_wrench_limit_set
    tool_wrench_limit_disable torque_command track_conveyor_circular track_conveyor_linear
    stop_conveyor_tracking trigger_pose write_port_bit write_port_register
"""
"""Other functions of the URScript manual: a call ends the program with an error."""


def _missing(name: str) -> Callable[..., Any]:
    def refuse(*_: object, **__: object) -> None:
        raise ScriptError(f"{name} is not emulated")

    return refuse


_INNER = frozenset({"press", "interpret", "let_go", "end"})
"""Attributes for the controller, not for programs."""


class Functions(Values, Robot, Sockets, Interpreter, Motions):
    """The functions of one program.

    Args:
        robot: the controller.
    """

    def __init__(self, robot: Controller) -> None:
        Sockets.__init__(self)
        Interpreter.__init__(self)
        self.robot = robot
        self._table = {name: _missing(name) for name in _NOT_EMULATED.split()} | {
            name: getattr(self, name)
            for part in Functions.__bases__
            for name in vars(part)
            if not name.startswith("_") and name not in _INNER
        }

    def table(self) -> dict[str, Callable[..., Any]]:
        """Return every function by its name; those that are not emulated raise when called."""
        return self._table
