"""Clients that are slow, silent, many or malicious; run with `make chaos`."""

import os
import socket
import time

import grpc
import pytest
from harness import DEVICE, channel_to, until
from motions import motion_of
from scenes import under_way
from stage import rehearse
from tally import Tally

from orientd.client.channel import MAX_MESSAGE_BYTES
from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
SETTINGS = b"\x00\x00\x00\x04\x00\x00\x00\x00\x00"


def descriptors(stage):
    """Return how many files the daemon has open."""
    return len(os.listdir(f"/proc/{stage.daemon.process.pid}/fd"))


def connected(stage):
    """Return a connection that says nothing yet."""
    line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    line.settimeout(5.0)
    line.connect(str(stage.daemon.socket))
    return line


def silent(stage, generator, tally):
    """Connect and send nothing, or half a request."""
    lines = [connected(stage) for _ in range(20)]
    for line in lines:
        line.sendall(PREFACE[: generator.randrange(len(PREFACE) + 1)])
    time.sleep(0.3)
    for line in lines:
        if generator.random() < 0.5:
            line.shutdown(socket.SHUT_WR)
    return lines


def garbage(stage, generator, tally):
    """Send bytes other than HTTP/2, or HTTP/2 frames of random bytes."""
    lines = []
    for _ in range(20):
        line = connected(stage)
        head = generator.choice((b"", PREFACE, PREFACE + SETTINGS))
        try:
            for _ in range(generator.randrange(1, 6)):
                line.sendall(head + generator.randbytes(generator.randrange(1, 20_000)))
                head = b""
        except OSError:
            tally.met["disconnected"] += 1
        lines.append(line)
    return lines


class Raw:
    """A client that sends bytes where messages belong."""

    METHODS = tuple(
        method.name for method in pb.DESCRIPTOR.services_by_name["Control"].methods
        if not method.client_streaming and not method.server_streaming
    )  # fmt: skip

    def __init__(self, stage):
        limit = 4 * MAX_MESSAGE_BYTES
        options = [
            ("grpc.max_send_message_length", limit),
            ("grpc.use_local_subchannel_pool", 1),
        ]
        self.channel = grpc.insecure_channel(f"unix:{stage.daemon.socket}", options=options)

    def call(self, method, content, timeout=10.0):
        """Send *content* to *method* and return the status."""
        call = self.channel.unary_unary(f"/orientd.v1.Control/{method}")
        try:
            call(content, timeout=timeout)
        except grpc.RpcError as error:
            code, details = error.code().name.lower(), error.details()
        else:
            return "ok"
        # gRPC itself answers unreadable messages.  Every other status must be an expected one.
        is_unreadable = code == "unknown" and "DecodeError" in details
        assert is_unreadable or code not in ("unknown", "internal"), (method, details)
        return "unreadable" if is_unreadable else code

    def close(self):
        self.channel.close()


def oversized(stage, generator, tally):
    """Send a message beyond the limit, and a long useless one below it."""
    raw = Raw(stage)
    met = [raw.call("Plan", bytes(MAX_MESSAGE_BYTES + generator.randrange(1, 9_000_000)), 20.0)]
    # 1 MB of a caller's name: Stop reports a part of it to the client of the motion.
    stop = pb.StopRequest(device="nobody", caller="x" * 1_000_000)
    met.append(raw.call("Stop", stop.SerializeToString()))
    for status in met:
        tally.met[status] += 1
    return [raw]


def _requests(token, generator):
    """Return a harmless request of every kind, for random changes."""
    turns = [[generator.uniform(-4, 4), 0.0, 0.0] for _ in range(3)]
    motion = motion_of(
        *({"rotation_vector": vector, "time": k} for k, vector in enumerate(turns)),
        start_velocity=[0.0, 0.0, 1.0],
        velocity_frame="body",
        approach=True,
    )
    return {
        "Plan": pb.PlanRequest(device=DEVICE, motion=motion, sample_rate_hz=10.0),
        "GetState": pb.GetStateRequest(device=DEVICE),
        "SetSpeed": pb.SetSpeedRequest(device=DEVICE, speed=0.5),
        "AcquireLease": pb.AcquireLeaseRequest(holder="fuzz"),
        "RenewLease": pb.RenewLeaseRequest(token=token),
        "Enable": pb.CommandRequest(device=DEVICE),
        "ListMethods": pb.ListMethodsRequest(),
    }


def spoiled(content, generator):
    """Return *content* with bytes changed, inserted, doubled or cut off."""
    content = bytearray(content)
    for _ in range(generator.randrange(1, 8)):
        where = generator.randrange(len(content) + 1)
        how = generator.randrange(4)
        if how == 0 and where < len(content):
            content[where] = generator.randrange(256)
        elif how == 1:
            content[where:where] = generator.randbytes(generator.randrange(1, 16))
        elif how == 2:
            content[where:where] = content[: generator.randrange(len(content) + 1)]
        else:
            del content[where:]
    return bytes(content)


def fuzzed(stage, generator, tally):
    """Send messages that were spoiled on the way, a hundred a round."""
    raw = Raw(stage)
    for _ in range(100):
        name, request = generator.choice(list(_requests("", generator).items()))
        if generator.random() < 0.2:
            content = generator.randbytes(generator.randrange(200))
        else:
            content = spoiled(request.SerializeToString(), generator)
        status = raw.call(name, content)
        assert status != "deadline_exceeded", (name, content)
        tally.met[status] += 1
    return [raw]


def slow(stage, generator, tally):
    """Ask for all cycles of the device, twenty times, and read none."""
    channels = [channel_to(stage.daemon.socket) for _ in range(20)]
    for channel in channels:
        request = pb.WatchStateRequest(device=DEVICE, rate_hz=100.0, decimation=1)
        stream = control_stub(channel).WatchState(request)
        next(stream)
        stage.streams.append(stream)
        stage.streams.append(control_stub(channel).WatchEvents(pb.WatchEventsRequest()))
    time.sleep(0.5)
    return channels


def crowd(stage, generator, tally):
    """Come a thousand at a time; every tenth asks something."""
    lines, answered = [], 0
    for number in range(1000):
        try:
            line = connected(stage)
        except OSError as error:
            tally.met[f"refused: {type(error).__name__}"] += 1
            continue
        lines.append(line)
        if number % 10 == 0:
            # Above its limit of connections, the daemon closes new ones at once.
            try:
                line.sendall(PREFACE + SETTINGS)
                answered += bool(line.recv(9))
            except OSError:
                tally.met["disconnected"] += 1
    tally.met["connected"] += len(lines)
    tally.met["answered"] += answered
    return lines


KINDS = {
    silent: "20 clients that send nothing or half a request, or half-close",
    garbage: "20 clients that send bytes other than HTTP/2",
    oversized: "messages beyond 64 MiB; a name of 1 MB",
    fuzzed: "100 fuzzed protobuf messages",
    slow: "20 clients that request every cycle and read none",
    crowd: "1000 connections at once",
}


@pytest.mark.parametrize("harm", KINDS, ids=lambda harm: harm.__name__)
def test_a_client_does_no_harm(tmp_path, harm):
    order = 30 + list(KINDS).index(harm)
    tally = Tally(KINDS[harm], order, "no fault, every call of other clients "
                  "answered, limits, status, open files closed")  # fmt: skip

    def one(stage, number, generator):
        before = descriptors(stage)
        pid = stage.servo
        with under_way(stage, number, generator):
            lines = harm(stage, generator, tally)
        stage.come_to_rest()
        stage.streams.clear()
        for line in lines:
            line.close()
        assert stage.servo == pid
        until(lambda: descriptors(stage) <= before + 8, "open files are closed", 10.0)
        stage.settle(faults=("none",))

    rehearse(tmp_path, f"client-{harm.__name__}", tally, one)
