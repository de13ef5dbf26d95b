"""Devices of the world: one seed decides every byte, and a killed process lets go of them."""

import os
import shutil
import signal

import pytest
from gimbal_bench import EmulatedGimbal, GimbalDaemon, await_hold, tap
from harness import until
from processes import World
from test_virtual_world import run
from virtual_time import BEGIN_NS, Scheduler

from emulated_ur import EmulatedRobot
from orientd import connect


def lives_of(life, folder):
    """Return what lives tell, two of them from one seed."""
    found = []
    for seed in ("a", "a", "b", "c", "d"):
        world, told = World(Scheduler(seed)), []
        folder.mkdir(exist_ok=True)
        run(world, lambda told=told: life(folder, told))
        found.append((told, world.scheduler.now_ns - BEGIN_NS))
        shutil.rmtree(folder)
    return found


def gimbal_life(folder, told):
    bus = EmulatedGimbal(folder / "bus")
    tapped = tap(folder / "tapped", bus.link)
    daemon = GimbalDaemon(folder, tapped.link).start()
    await_hold(daemon, "gimbal")
    with connect(daemon.socket) as robot:
        bus.tell("drop 2 0.05 5")
        aim = {"azimuth_elevation": {"azimuth": 40, "elevation": 30}}
        told.append(robot.move([aim], approach=True).wait(30.0).outcome)
        os.kill(robot.state().devices["gimbal"].servo_pid, signal.SIGKILL)
    await_hold(daemon, "gimbal")
    daemon.end()
    told.append(tapped.reader.written)
    bus.end()


def arm_life(_folder, told):
    with EmulatedRobot("127.0.0.7") as robot:
        robot.ask("protective_stop")
        until(lambda: robot.state()["is_still"], "rest")
        told.append(robot.state())


@pytest.mark.parametrize("life", [gimbal_life, arm_life])
def test_a_seed_repeats_every_byte(life, tmp_path):
    pytest.importorskip("dynamixel_sdk")
    first, again, *others = lives_of(life, tmp_path / "life")
    assert first == again
    # The cycles of a bus are the same; the seed decides in which of them something happens.
    assert life is arm_life or any(first != other for other in others)
