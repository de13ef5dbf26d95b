"""A program that a driver feeds over a socket of its own, as ROS drivers control an arm."""

import socket
import struct
import time
from contextlib import contextmanager

import pytest

SCRIPT = """
def external_control():
  SCALE = 1000000
  IDLE = 0
  SERVO = 1
  SPEED = 2
  TRAJECTORY = 3
  global mode = IDLE
  global goal = get_actual_joint_positions()
  global points_left = 0
  thread_move = 0

  thread servo():
    while mode == SERVO:
      enter_critical
      q = goal
      exit_critical
      servoj(q, t=get_steptime(), lookahead_time=0.03, gain=1000)
    end
    stopj(4.0)
  end

  thread speed():
    while mode == SPEED:
      speedj(goal, 40.0, get_steptime())
    end
    stopj(4.0)
  end

  thread trajectory():
    enter_critical
    while points_left > 0:
      point = socket_read_binary_integer(7, "driver", 0.5)
      points_left = points_left - 1
      if point[0] > 0:
        movej([point[1], point[2], point[3], point[4], point[5], point[6]] / SCALE,
          t = point[7] / SCALE)
      end
    end
    exit_critical
    socket_send_int(0, "driver")
  end

  def connect(tries=5):
    local n = 0
    while n < tries:
      if socket_open("HOST", PORT, "driver"):
        return True
      end
      sleep(0.1)
      n = n + 1
    end
    return False
  end

  if not connect():
    popup("no driver", title="External control", blocking=True, error=True)
    halt
  end
  textmsg("connected")
  while True:
    enter_critical
    order = socket_read_binary_integer(7, "driver", 0.2)
    if order[0] > 0:
      if order[1] != mode:
        mode = order[1]
        join thread_move
        if mode == SERVO:
          thread_move = run servo()
        elif mode == SPEED:
          thread_move = run speed()
        end
      end
      if mode == TRAJECTORY:
        points_left = order[2]
        thread_move = run trajectory()
        join thread_move
      elif mode == IDLE or
        mode == SERVO or mode == SPEED:
        goal = [order[2], order[3], order[4], order[5], order[6], order[7]] / SCALE
      end
    else:
      textmsg("timed out")
      mode = IDLE
      kill thread_move
      stopj(4.0)
      halt
    end
    exit_critical
  end
end
"""


@contextmanager
def driven(robot):
    """The program, playing, and the driver's end of its socket."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        server.settimeout(5.0)
        text = SCRIPT.replace("HOST", "127.0.0.1").replace("PORT", str(port))
        with socket.create_connection((robot.host, 30002), timeout=5.0) as uploading:
            uploading.sendall(text.encode())
            link, _ = server.accept()
        with link:
            link.settimeout(5.0)
            yield link


def order(link, mode, values):
    link.sendall(struct.pack(">7i", mode, *(round(one * 1e6) for one in values)))
    time.sleep(0.004)


def test_driver_streams_setpoints_then_speeds(ur_robot):
    start = ur_robot.state()["target_q"]
    with driven(ur_robot) as link:
        for step in range(100):
            order(link, 1, [start[0] + 0.001 * step, *start[1:]])
        ur_robot.wait_until(lambda state: state["target_q"][0] > start[0] + 0.05)
        for _ in range(50):
            order(link, 2, [-0.2, 0, 0, 0, 0, 0])
        ur_robot.wait_until(lambda state: state["told"][-1] == "timed out")
        state = ur_robot.wait_until(lambda state: state["runtime_state"] == "STOPPED")
    assert state["log"] == []
    assert state["is_still"]


def test_driver_forwards_a_trajectory(ur_robot):
    start = ur_robot.state()["target_q"]
    with driven(ur_robot) as link:
        link.sendall(struct.pack(">7i", 3, 2, 0, 0, 0, 0, 0))
        for turn in (0.1, 0.2):
            goal = [start[0] + turn, *start[1:], 0.3]
            link.sendall(struct.pack(">7i", *(round(one * 1e6) for one in goal)))
        assert link.recv(4) == bytes(4)
        assert ur_robot.state()["target_q"][0] == pytest.approx(start[0] + 0.2, abs=1e-5)


def test_statements_on_lines_of_their_own_and_what_is_said_of_errors(ur_robot):
    with socket.create_connection((ur_robot.host, 30001), timeout=5.0) as link:
        link.sendall(b"set_digital_out(0, True)\n")
        ur_robot.wait_until(lambda state: state["digital_outputs"] == 1)
        link.sendall(b"movej([0.1, -1.57, 1.4, -1.4, -1.57, 0], a=3, v=3)\r\n")
        ur_robot.wait_until(lambda state: abs(state["target_q"][0] - 0.1) < 1e-9)
        link.sendall(b"go_home()\n")
        ur_robot.wait_until(lambda state: "name_not_found:go_home:" in str(state["log"]))
        heard = b""
        while b"compile_error_name_not_found:go_home:" not in heard:
            heard += link.recv(65536)
    assert b"PROGRAM_XXX_STARTED" in heard
