"""A UR controller that is slow, silent, frozen, locked or wrong during a motion; `make chaos`.

In each round the motion ends in a fault with its reason.  The daemon answers stops within a second
while commands wait for the device.  Afterwards the arm makes a motion.
"""

import contextlib
import time

import pytest
from device_stage import DeviceStage
from harness import request_of, until
from tally import Tally, rounds_of

from emulated_ur import EmulatedRobot
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import word

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]

HARMS = {
    "a dashboard server that trickles": (("dashboard 0.3", "protective_stop"), "dashboard 0"),
    "a silent dashboard server": (("dashboard 1000", "protective_stop"), "dashboard 0"),
    "a protective stop locked for 5 s": (("protective_stop",), ""),
    "a frozen controller": (("freeze",), "thaw"),
    "no data packages": (("silence",), "speak"),
    "garbage on the link": (("garbage 7",), ""),
    "closed connections": (("drop all",), ""),
}


def each_call_once(stage):
    """Send every command, and measure those that stop."""
    robot = stage.robot
    for name in ("Reset", "Stop", "Halt", "Enable", "Disable", "Enable", "Stop", "Reset", "Stop"):

        def call(name=name):
            request = request_of(name)(device=stage.device)
            if name not in ("Stop", "Halt"):
                request.lease_token = robot.lease_token
            robot._connection.ask(getattr(robot._stub, name), request)

        # The tests of the driver check the error itself.
        with contextlib.suppress(OrientdError):
            if name in ("Stop", "Halt"):
                stage.calls.measure(name, call)
            else:
                call()


@pytest.mark.parametrize("harm", HARMS)
def test_a_controller_takes_its_time(tmp_path, harm):
    pytest.importorskip("rtde_control")
    orders, mend = HARMS[harm]
    tally = Tally(f"a UR arm: {harm}", 65, "fault with its reason, every stop within 1 s, a motion")

    def one(_number, generator):
        with stage.round():
            handle = stage.turn()
            time.sleep(generator.uniform(0.2, 1.5))
            robot = EmulatedRobot(stage.words[2])
            for order in orders:
                robot.ask(order)
            try:
                until(lambda: stage.state().state == pb.STATE_FAULT, "the fault", 4.0)
                until(lambda: stage.state().fault_text, "the fault in words", 1.0)
                stage.tally.met[word(stage.state(), "fault")] += 1
                handle.wait(5.0)
                each_call_once(stage)
            finally:
                if mend:
                    robot.ask(mend)
                robot.end()
            until(lambda: _recovered(stage), "recovery", 30.0)

    with DeviceStage(tmp_path, tally, "ur") as stage:
        rounds_of("ur-" + harm.replace(" ", "-"), tally, one)


def _recovered(stage):
    try:
        stage.recover()
    except OrientdError:
        return False
    return True
