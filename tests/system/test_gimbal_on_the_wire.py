"""After a fault no goal on the wire leads away: a real daemon, read between it and the servos."""

import random
import time
from contextlib import closing

import pytest
from gimbal_bench import GimbalDaemon, seldom, tap
from harness import until

import orientd
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb

pytest.importorskip("dynamixel_sdk")

pytestmark = pytest.mark.world

DEVICE = "gimbal"
DEGREE = 4096 / 360
SERVOS = (1, 2, 3)
CAUSES = {"jam": "jam {}", "overload": "error {} 32", "voltage": "error {} 1", "silent": "drop {}"}
ROUNDS = [
    pytest.param(1, id="once"),
    pytest.param(50, id="many", marks=[pytest.mark.slow, pytest.mark.timeout(1200)]),
]


@pytest.fixture
def tee(bus, tmp_path):
    it = tap(tmp_path / "tapped", bus.link)
    yield it
    it.end()


@pytest.fixture
def daemon(tee, tmp_path):
    it = GimbalDaemon(tmp_path, tee.link).start()
    yield it
    print(it.end()[1])


@pytest.fixture
def robot(daemon):
    with closing(orientd.connect(daemon.socket)) as it:
        yield it


def positions(bus):
    return [bus.state(servo)["position"] for servo in SERVOS]


def hold(robot):
    """Have the gimbal hold again, which a busy machine may keep it from at first."""
    told = []

    def holds():
        now = robot.state().devices[DEVICE]
        if now.state in (pb.STATE_FAULT, pb.STATE_IDLE):
            told.append(now.fault_text)
            try:
                robot.reset(DEVICE)
            except OrientdError as error:
                told.append(str(error))
        return now.state == pb.STATE_HOLDING

    try:
        until(seldom(holds), "rest")
    except AssertionError as error:
        raise AssertionError(robot.state().devices[DEVICE].state, told) from error


def let_go(bus, servo):
    """Undo what any cause does, but for what a servo remembers."""
    bus.tell(f"free {servo}")
    bus.tell(f"clear {servo}")


@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("rounds", ROUNDS)
def test_no_goal_on_the_wire_leads_away_after_a_fault(bus, tee, robot, cause, rounds):
    chance = random.Random(rounds)

    start, end = {"rotation_vector": [0.3, 0.4, 0.8]}, {"rotation_vector": [-0.3, -0.4, -0.8]}
    for _ in range(rounds):
        hold(robot)
        robot.move([start], approach=True).wait(30.0)
        robot.move([end], approach=True)
        time.sleep(chance.uniform(0.2, 1.2))
        servo = chance.choice(SERVOS)
        bus.tell(CAUSES[cause].format(servo))
        until(lambda: robot.state().devices[DEVICE].state == pb.STATE_FAULT, "the fault")
        # What brakes has come to rest by then.
        time.sleep(0.5)
        stood, written = positions(bus), len(tee.reader.written)
        goals = [tee.reader.goals(one)[-1] for one in SERVOS]
        let_go(bus, servo)
        for _ in range(10):
            time.sleep(0.02)
            assert max(abs(a - b) for a, b in zip(positions(bus), stood, strict=True)) < DEGREE
        for one, goal, at in zip(SERVOS, goals, stood, strict=True):
            later = [goal, *tee.reader.goals(one, written)]
            assert max(abs(tick - at) for tick in later) < DEGREE
            assert later[-1] == bus.state(one)["goal"]
        assert tee.reader.damaged == 0


def test_an_axis_that_lags_when_another_fails_stays_where_it_is(bus, tee, robot):
    hold(robot)
    robot.move([{"euler": {"axes": "ZYX", "degrees": [80, 40, 0]}}], approach=True)
    until(lambda: bus.state(2)["position"] > 2048 + 10 * DEGREE, "pitch on its way")
    # Not for so long that this servo reports an overload too.
    bus.tell("jam 2")
    time.sleep(0.1)
    bus.tell("error 1 32")
    until(lambda: robot.state().devices[DEVICE].state == pb.STATE_FAULT, "the fault")
    time.sleep(0.2)
    stood = bus.state(2)
    bus.tell("free 2")
    time.sleep(0.5)
    assert stood["torque"] == bus.state(2)["torque"] == 1
    assert abs(bus.state(2)["position"] - stood["position"]) < DEGREE
    assert abs(bus.state(2)["goal"] - stood["position"]) < DEGREE
    let_go(bus, 1)
