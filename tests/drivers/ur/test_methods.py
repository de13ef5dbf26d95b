"""The client library's own methods, one by one: each has its documented effect, or fails.

`sim/emulated_ur/METHODS.md` lists the untested methods, too, with the reasons.
"""

import os
import socket

import pytest
from ur_rig import until

from emulated_ur import EmulatedRobot

rtde_control = pytest.importorskip("rtde_control")

HOME = [0.0, -1.5708, 1.3963, -1.3963, -1.5708, 0.0]
AWAY = [0.15, *HOME[1:]]
DOWN = [0.0, 0.0, -0.05, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def link():
    """One emulated robot and one client for all of these tests: both take a while to begin."""
    run = os.getpid()
    with EmulatedRobot(f"127.{1 + run // 200 % 250}.{1 + run % 200}.251") as robot:
        client = rtde_control.RTDEControlInterface(robot.host)
        yield robot, client
        client.disconnect()


@pytest.fixture
def ur_robot(link):
    return link[0]


@pytest.fixture
def control(link):
    robot, client = link
    robot.ask("contact off")
    if robot.state()["runtime_state"] != "PLAYING":
        assert client.reuploadScript()
        until(client.isProgramRunning, "the program")
    assert client.moveJ(HOME, 2.0, 10.0)
    return client


def joints(robot):
    return robot.state()["target_q"]


def height(robot):
    return robot.state()["actual_pose"][2]


def settled(robot):
    return robot.wait_until(lambda state: state["is_still"])


def lowered(robot, by=0.05):
    pose = list(robot.state()["actual_pose"])
    pose[2] -= by
    return pose


def test_joint_path_passes_every_waypoint(ur_robot, control):
    assert control.moveJ([[*AWAY, 2.0, 10.0, 0.0], [*HOME[:5], 0.1, 2.0, 10.0, 0.0]])
    assert joints(ur_robot) == pytest.approx([*HOME[:5], 0.1], abs=1e-9)


def test_tool_path_moves_the_tool(ur_robot, control):
    goal = lowered(ur_robot)
    assert control.moveL([[*goal, 0.5, 5.0, 0.0]])
    assert height(ur_robot) == pytest.approx(goal[2], abs=1e-3)


def test_mixed_path_moves(ur_robot, control):
    path = rtde_control.Path()
    kinds = rtde_control.PathEntry
    path.addEntry(kinds(kinds.MoveJ, kinds.PositionJoints, [*AWAY, 2.0, 10.0, 0.0]))
    assert control.movePath(path)
    assert joints(ur_robot) == pytest.approx(AWAY, abs=1e-9)


@pytest.mark.parametrize("form", ["moveJ", "moveL", "path"])
def test_asynchronous_move_returns_at_once_and_tells_its_progress(ur_robot, control, form):
    if form == "moveJ":
        control.moveJ(AWAY, 0.3, 1.0, True)
    elif form == "moveL":
        control.moveL(lowered(ur_robot), 0.1, 0.5, True)
    else:
        control.moveJ([[*AWAY, 0.3, 1.0, 0.0]], True)
    assert not ur_robot.state()["is_still"]
    until(lambda: control.getAsyncOperationProgress() >= 0, "under way")
    until(lambda: control.getAsyncOperationProgress() < 0, "the end")
    assert settled(ur_robot)["target_q"] != pytest.approx(HOME, abs=1e-3)


def test_asynchronous_move_is_stopped(ur_robot, control):
    control.moveJ(AWAY, 0.1, 1.0, True)
    ur_robot.wait_until(lambda state: not state["is_still"])
    control.stopJ(10.0)
    assert abs(settled(ur_robot)["target_q"][0]) < 0.1
    assert control.getAsyncOperationProgress() < 0


def test_jog_moves_in_its_frame_until_it_is_stopped(ur_robot, control):
    before = height(ur_robot)
    assert control.jogStart(DOWN, rtde_control.RTDEControlInterface.FEATURE_TOOL)
    # The tool points down, so its z is the base's -z.
    ur_robot.wait_until(lambda state: state["actual_pose"][2] > before + 0.005)
    assert control.jogStop()
    assert settled(ur_robot)


def test_force_mode_gives_way_along_the_axis_that_is_free(ur_robot, control):
    before = ur_robot.state()["actual_pose"]
    assert control.forceMode([0.0] * 6, [0, 0, 1, 0, 0, 0], [9.0, 0, -9.0, 0, 0, 0], 2, [0.1] * 6)
    found = ur_robot.wait_until(lambda state: state["actual_pose"][2] < before[2] - 0.01)
    assert found["actual_pose"][0] == pytest.approx(before[0], abs=1e-4)
    assert control.forceModeStop()
    assert settled(ur_robot)


def test_move_until_contact_ends_with_the_contact(ur_robot, control):
    before = height(ur_robot)
    ur_robot.ask("contact on")
    assert control.moveUntilContact(DOWN)
    assert height(ur_robot) == pytest.approx(before, abs=1e-3)


@pytest.mark.slow
def test_servo_c_goes_to_its_pose(ur_robot, control):
    goal = lowered(ur_robot, 0.03)
    assert control.servoC(goal, 0.25, 1.2, 0.0)
    ur_robot.wait_until(lambda state: abs(state["actual_pose"][2] - goal[2]) < 1e-3)
    control.kickWatchdog()  # writes 0, as the library itself does not after this command
    assert control.servoStop()


def test_timed_speed_goes_on_as_the_control_script_repeats_it(ur_robot, control):
    assert control.speedJ([0.2, 0.0, 0.0, 0.0, 0.0, 0.0], 5.0, 0.05)
    ur_robot.wait_until(lambda state: state["target_q"][0] > 0.03)
    assert control.speedStop()
    assert settled(ur_robot)


def test_custom_script_runs_and_ends(ur_robot, control):
    move = "movej([0.1,-1.5708,1.3963,-1.3963,-1.5708,0],a=9,v=2)\n"
    assert control.sendCustomScriptFunction("custom", move)
    assert joints(ur_robot)[0] == pytest.approx(0.1)
    done = "  write_output_integer_register(0, 2)\nend\n"
    assert control.sendCustomScript(f"def custom():\n  {move.replace('0.1', '0.0')}{done}")
    assert joints(ur_robot)[0] == pytest.approx(0.0)


def test_example_of_a_nested_function_in_a_custom_script_runs(ur_robot, control):
    inner = "  def inner(x):\n    return x + 1\n  end\n"
    body = "  write_output_float_register(5, inner(inner(1.5)))\n"
    done = "  write_output_integer_register(0, 2)\n"
    assert control.sendCustomScript(f"def outer():\n{inner}{body}{done}end\n")
    assert "refused" not in str(ur_robot.state()["log"])


def test_program_with_a_name_that_is_not_there_is_refused_in_words(ur_robot, control):
    control.stopScript()
    until(lambda: ur_robot.state()["runtime_state"] == "STOPPED", "the end")
    with socket.create_connection((ur_robot.host, 30003), timeout=5.0) as sock:
        sock.sendall(b"def other():\n  x = get_tcp_pose()\nend\n")
        found = ur_robot.wait_until(
            lambda state: any("name_not_found:get_tcp_pose: (line 2)" in s for s in state["log"])
        )
    assert found["runtime_state"] == "STOPPED"


def test_forward_kinematics_heed_the_tool_that_is_given(control):
    bare = control.getForwardKinematics(HOME, [0.0, 0.0, 0.0, 0.0, 0.0, 1e-9])
    tool = control.getForwardKinematics(HOME, [0.0, 0.0, 0.2, 0.0, 0.0, 0.0])
    assert bare[2] - tool[2] == pytest.approx(0.2, abs=1e-3)  # the tool points down


def test_tool_speed_is_taken_on_at_the_acceleration_that_is_given(ur_robot, control):
    before = height(ur_robot)
    assert control.speedL([0.0, 0.0, -0.05, 0.0, 0.0, 0.0], 0.05)
    ur_robot.wait_until(lambda state: state["actual_pose"][2] < before - 0.005)
    # 5 mm from rest at 0.05 m/s^2 take 0.45 s, and 0.1 s at once.
    assert control.speedStop()
    assert settled(ur_robot)


def test_payload_without_a_centre_keeps_the_one_that_is_set(ur_robot, control):
    assert control.setPayload(1.0, [0.0, 0.0, 0.05])
    assert control.setPayload(2.0, [0.0, 0.0, 0.0])
    state = ur_robot.state()
    assert (state["payload"], state["payload_cog"]) == (2.0, [0.0, 0.0, 0.05])
