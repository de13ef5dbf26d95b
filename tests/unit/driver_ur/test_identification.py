"""Identification of an arm from its controller's bytes, on a socket of the test."""

import contextlib
import math
import socket
import struct
import threading

import pytest

from orientd.errors import LinkError
from orientd_ur.arm import MODELS
from orientd_ur.kinematics import Kinematics
from orientd_ur.primary import ask
from orientd_ur.wire import PRIMARY_PORT

TWISTS = [math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0]
UR10E_A, UR10E_D = [0, -0.6127, -0.57155, 0, 0, 0], [0.1807, 0, 0, 0.17415, 0.11985, 0.11655]


def framed(kind, contents):
    return struct.pack(">iB", 5 + len(contents), kind) + contents


def configuration(
    a, d, twists=TWISTS, *, speeds=(2.0,) * 6, most=math.tau, kind=2, acceleration=40.0
):
    numbers = [x for _ in range(6) for x in (-most, most)]
    numbers += [x for speed in speeds for x in (speed, acceleration)]
    numbers += [0.0] * 5 + [*a, *d, *twists, *[0.0] * 6]
    return framed(6, struct.pack(">53d4i", *numbers, 2, 0, kind, 0) + b"appended later")


def kinematics(theta, a, d, alpha):
    return framed(5, struct.pack(">6I24dI", *[7] * 6, *theta, *a, *d, *alpha, 1))


@pytest.fixture
def told(request):
    """Answer as a controller whose state messages are the ones given, and return its arm."""
    address = f"127.98.{len(request.node.name) % 250 + 1}.{abs(hash(request.node.name)) % 250 + 1}"

    def tell(*messages, timeout=5.0):
        with socket.create_server((address, PRIMARY_PORT)) as server:

            def serve():
                peer, _ = server.accept()
                with peer, contextlib.suppress(OSError):
                    for message in messages:
                        peer.sendall(message)
                    peer.recv(1)

            thread = threading.Thread(target=serve)
            thread.start()
            try:
                return ask(address, timeout)
            finally:
                thread.join()

    return tell


def speeds(arm):
    return [axis.velocity for axis in arm.axes]


def ranges(arm):
    return [(axis.low, axis.high) for axis in arm.axes]


VERSION = framed(20, b"greeting")


def test_model_is_known_and_never_faster_than_published(told):
    message = framed(16, framed(0, b"mode") + configuration(UR10E_A, UR10E_D, speeds=(2.0,) * 6))
    without = framed(16, framed(0, b"mode"))
    arm = told(VERSION, without, message, without, without)
    assert (arm.name, arm.kinematics.is_calibrated) == ("ur10e", False)
    assert speeds(arm) == [2.0] * 6
    assert ranges(arm) == [(-math.tau, math.tau)] * 6
    fast = framed(16, configuration(UR10E_A, UR10E_D, speeds=(9.0,) * 6))
    assert tuple(speeds(told(fast, without, without))) == MODELS["ur10e"].speeds


@pytest.mark.parametrize(("told_as", "taken"), [(25.0, 25.0), (0.0, 40.0)])
def test_acceleration_of_the_joints_is_what_the_controller_says_if_it_does(told, told_as, taken):
    state = framed(16, configuration(UR10E_A, UR10E_D, acceleration=told_as))
    assert [axis.acceleration for axis in told(state, state, state).axes] == [taken] * 6


@pytest.mark.parametrize(("said", "most"), [(3.0, 3.0), (9.0, math.tau), (0.0, math.tau)])
def test_range_of_the_joints_is_never_more_than_published(told, said, most):
    state = framed(16, configuration(UR10E_A, UR10E_D, most=said))
    assert ranges(told(state, state, state)) == [(-most, most)] * 6


def test_calibration_of_the_arm_is_taken(told):
    own = kinematics([1e-3] * 6, UR10E_A, UR10E_D, TWISTS)
    arm = told(framed(16, own + configuration(UR10E_A, UR10E_D)))
    assert arm.kinematics.is_calibrated
    published = Kinematics(MODELS["ur10e"].links)
    _, position = arm.kinematics.forward([0.2] * 6)
    assert position != pytest.approx(published.forward([0.2] * 6)[1], abs=1e-4)
    assert position == pytest.approx(published.forward([0.201] * 6)[1], abs=1e-12)
    plain = told(framed(16, kinematics([0.0] * 6, UR10E_A, UR10E_D, TWISTS) +
                        configuration(UR10E_A, UR10E_D)))  # fmt: skip
    assert not plain.kinematics.is_calibrated


def test_unknown_arm_is_taken_as_it_is_described(told):
    a, d = [0, -0.4, -0.35, 0, 0, 0], [0.2, 0, 0, 0.15, 0.11, 0.1]
    state = framed(16, configuration(a, d, kind=5, most=1e9))
    arm = told(state, state, state)
    assert (arm.name, arm.kinematics.links.forearm) == ("arm of type 5", 0.35)
    assert ranges(arm) == [(-math.inf, math.inf)] * 6


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ([framed(16, configuration(UR10E_A, UR10E_D, [0.5] * 6))], "not built like the known ones"),
        ([b"\x00\x00\x00\x01\x00"], "a message of 1 bytes"),
        ([framed(16, struct.pack(">iB", 99, 6))], "longer than its message"),
    ],
)
def test_nonsense_is_refused_in_words(told, messages, words):
    with pytest.raises(LinkError, match=words):
        told(*messages, *messages, *messages)


def test_silence_is_bounded(told):
    with pytest.raises(LinkError, match="did not send a description of its arm: timed out"):
        told(VERSION, timeout=0.05)
