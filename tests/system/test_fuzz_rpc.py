"""Calls that no client would make: random and mutated bytes through a bare channel."""

import contextlib
import math
import os
import random
from collections import Counter

import grpc
import pytest
from every_call import SERVICE, call
from harness import DaemonProcess, is_alive, resident_kib, until
from motions import motion_of
from nonsense import pour

from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

LONG = int(os.environ.get("ORIENTD_FUZZ_CALLS", "1000000"))
PARTS = 10
GROWTH_KIB = 8 * 1024
EXPECTED = {
    "OK", "INVALID_ARGUMENT", "NOT_FOUND", "FAILED_PRECONDITION", "PERMISSION_DENIED",
    "RESOURCE_EXHAUSTED", "DEADLINE_EXCEEDED", "CUT SHORT",
}  # fmt: skip

STOP = SERVICE.methods_by_name["Stop"]
LOOK = SERVICE.methods_by_name["ListDevices"]


def limited(folder, text):
    daemon = DaemonProcess(folder)
    daemon.config.write_text(f"[access]\n{text}\n" + daemon.config.read_text())
    return daemon


def connection(daemon):
    """Return a channel with a connection that it shares with no other."""
    options = (("grpc.use_local_subchannel_pool", 1),)
    return grpc.insecure_channel(f"unix:{daemon.socket}", options)


def total(codes):
    """Return how many calls ended with each status, whatever their method."""
    found = Counter()
    for (_, code), count in codes.items():
        found[code] += count
    return found


def check(daemon, calls, seed):
    rng = random.Random(seed)
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
    servo, began = daemon.device().servo_pid, daemon.sent()[0]
    # The compiled kernels come in one by one, behind the first plans.
    before, now = 0, resident_kib(daemon.process.pid)
    for _ in range(60):
        pour(daemon.socket, rng, 100)
        before, now = now, resident_kib(daemon.process.pid)
        if now - before < 1024:
            break
    sizes, codes = [now], Counter()
    for part in range(PARTS):
        codes += pour(daemon.socket, rng, calls // PARTS)
        sizes.append(resident_kib(daemon.process.pid))
        if calls >= LONG:
            print(f"{(part + 1) * (calls // PARTS)} calls: {sizes[-1]} KiB", flush=True)
    print(f"{calls} calls: {dict(total(codes))}, KiB {sizes}")
    # Not UNAVAILABLE: then the daemon would be gone; nor UNKNOWN, which is a traceback in its log.
    assert set(total(codes)) <= EXPECTED, codes
    assert b"Traceback" not in (daemon.folder / "log").read_bytes()
    assert {method for method, _ in codes} == {method.name for method in SERVICE.methods}
    assert sizes[-1] - sizes[1] < GROWTH_KIB
    device = daemon.device()
    assert device.servo_pid == servo
    assert is_alive(servo)
    assert (device.state, device.fault) == (pb.STATE_HOLDING, pb.FAULT_NONE)
    assert device.motion_number == 0
    assert (daemon.sent() == began).all()


def test_calls_of_nonsense_move_nothing(tmp_path):
    with DaemonProcess(tmp_path) as daemon:
        check(daemon, 300, seed=7)


@pytest.mark.slow
@pytest.mark.timeout(0)
def test_many_calls_of_nonsense_move_nothing(tmp_path):
    # Slowly, for every setpoint of an hour is looked at.
    with DaemonProcess(tmp_path, rate_hz=50.0, memory=1.0) as daemon:
        check(daemon, LONG, seed=8)


@pytest.mark.parametrize("name", ["keyframes", "columns"])
def test_a_message_too_large_or_a_motion_too_long_is_refused(tmp_path, name):
    def motion(count):
        turns = [(math.cos(0.001 * k), math.sin(0.001 * k)) for k in range(count)]
        if name == "columns":
            numbers = [number for w, x in turns for number in (w, x, 0.0, 0.0)]
            columns = pb.KeyframeColumns(quaternions=numbers)
            return pb.PlanRequest(motion=b"{}", columns=columns.SerializeToString())
        keyframes = [{"quaternion": {"w": w, "x": x, "y": 0, "z": 0}} for w, x in turns]
        return pb.PlanRequest(motion=motion_of(*keyframes))

    with limited(tmp_path, "message_bytes = 20000\nkeyframes = 50") as daemon:
        stub = control_stub(daemon.channel)
        stub.Plan(motion(50))
        with pytest.raises(grpc.RpcError, match="keyframes: expected at most 50, got 51"):
            stub.Plan(motion(51))
        with pytest.raises(grpc.RpcError, match="the message is too large"):
            stub.Plan(motion(2000))


def test_bytes_that_are_no_request_are_refused_in_one_line(tmp_path):
    with DaemonProcess(tmp_path) as daemon:
        assert {call(daemon.channel, LOOK, [b"\xff\xff"]) for _ in range(6)} == {"INVALID_ARGUMENT"}
        assert "Traceback" not in (daemon.folder / "log").read_text()


def test_a_key_that_is_no_longer_used_is_named(tmp_path):
    keys = "requests_per_second", "streamed_bytes", "streamed_keyframes"
    with limited(tmp_path, "\n".join(f"{key} = 1" for key in keys)) as daemon:
        assert call(daemon.channel, LOOK, [pb.ListDevicesRequest()]) == "OK"
        log = (daemon.folder / "log").read_text()
        for key in keys:
            assert f"access.{key} is no longer used: remove it" in log


def test_who_has_too_many_calls_open_is_refused_but_may_stop(tmp_path):
    with limited(tmp_path, "streams = 2") as daemon, connection(daemon) as busy:
        watch = control_stub(busy).WatchState
        held = [watch(pb.WatchStateRequest()) for _ in range(2)]
        for stream in held:
            next(stream)
        assert call(busy, LOOK, [pb.ListDevicesRequest()]) == "RESOURCE_EXHAUSTED"
        assert call(busy, STOP, [pb.StopRequest()]) == "OK"
        for stream in held:
            stream.cancel()
        until(lambda: call(busy, LOOK, [pb.ListDevicesRequest()]) == "OK", "room for a call")


def test_who_has_far_too_many_connections_in_use_is_turned_away(tmp_path):
    with limited(tmp_path, "connections = 2") as daemon, contextlib.ExitStack() as opened:
        held = []
        for _ in range(4):
            channel = opened.enter_context(connection(daemon))
            held.append(control_stub(channel).WatchState(pb.WatchStateRequest()))
            next(held[-1])
        one_more = opened.enter_context(connection(daemon))
        assert call(one_more, LOOK, [pb.ListDevicesRequest()]) == "UNAVAILABLE"
        log, turned_away = daemon.folder / "log", "has 4 connections already, all in use"
        until(lambda: turned_away in log.read_text(), "the line of the log")
        held.pop().cancel()
        # An idle one gives way.
        until(lambda: call(one_more, LOOK, [pb.ListDevicesRequest()]) == "OK", "room")
        for stream in held:
            stream.cancel()


def test_who_has_every_connection_in_use_may_stop_and_is_told_what_is_too_much(tmp_path):
    limits = "connections = 2\nstreams = 2"
    with limited(tmp_path, limits) as daemon, contextlib.ExitStack() as opened:
        held = []
        for _ in range(2):
            channel = opened.enter_context(connection(daemon))
            held.append(control_stub(channel).WatchState(pb.WatchStateRequest()))
            next(held[-1])
        third = opened.enter_context(connection(daemon))
        assert call(third, STOP, [pb.StopRequest()]) == "OK"
        assert call(third, LOOK, [pb.ListDevicesRequest()]) == "RESOURCE_EXHAUSTED"
        for stream in held:
            stream.cancel()
