"""Kill, freeze and disconnect the controller at random moments, many times; slow."""

import os
import random
import time

import pytest
from ur_rig import device_of, fault_of, is_alive, recover, streaming, swing, until

from orientd.errors import Fault

pytest.importorskip("rtde_control")

ROUNDS = int(os.environ.get("ORIENTD_UR_ROUNDS", "50"))


def kill(robot):
    robot.process.kill()
    robot.process.wait()


def freeze(robot):
    robot.ask("freeze")


def drop(robot):
    robot.ask("drop rtde")


def revive(robot):
    if robot.process.poll() is None:
        robot.ask("thaw")
    else:
        robot.end()
        robot.start()


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("harm", [kill, freeze, drop])
def test_every_loss_ends_within_a_second_and_is_recovered_from(ur_robot, harm):
    generator, slowest, kinds, servos = random.Random(5), 0.0, {}, set()
    with device_of(ur_robot.host, lookahead=0.1) as device:
        home = device.commanded().q
        for _ in range(ROUNDS):
            servos.add(pid := device.snapshot().servo_pid)
            # Each loss leaves the arm a little further on, and in the end a wrist wound up.
            swing(device, seconds=4.0, home=home)
            streaming(device)
            moment = device.snapshot().path_time + generator.uniform(0.0, 1.5)
            until(
                lambda moment=moment: device.snapshot().path_time > moment,
                lambda: f"the moment {device.snapshot()}",
            )
            begun = time.monotonic()
            harm(ur_robot)
            fault, _, _ = fault_of(device)
            if fault is Fault.FEEDBACK_STALE:
                until(lambda pid=pid: device.snapshot().servo_pid != pid, "the servo's end", 3.0)
            slowest = max(slowest, time.monotonic() - begun)
            kinds[fault.name] = kinds.get(fault.name, 0) + 1
            revive(ur_robot)
            recover(device)
        servos.add(device.snapshot().servo_pid)
    print(f"{harm.__name__}: {ROUNDS} rounds, slowest end {slowest:.3f} s, {kinds}")
    assert slowest < 1.5
    assert not [pid for pid in servos if is_alive(pid)]
