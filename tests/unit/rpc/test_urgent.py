"""A call made without gRPC's library, to a server that is made with it."""

import socket
import struct
from concurrent import futures

import grpc
import pytest

from orientd.rpc import control_pb2 as pb
from orientd.rpc import urgent
from orientd.rpc.control_pb2_grpc import ControlServicer, add_ControlServicer_to_server

STOP = "orientd.v1.Control/Stop"


class Devices(ControlServicer):
    """As many devices as are asked for by the name of the caller."""

    def Stop(self, request, context):  # noqa: N802 - gRPC's name
        if request.device:
            context.abort(grpc.StatusCode.NOT_FOUND, "no such device")
        report = pb.DeviceReport(fault_text="x" * 1000)
        return pb.StopResponse(devices=[report] * int(request.caller))


@pytest.fixture
def path(tmp_path):
    server = grpc.server(futures.ThreadPoolExecutor(1))
    add_ControlServicer_to_server(Devices(), server)
    server.add_insecure_port(f"unix:{tmp_path / 'socket'}")
    server.start()
    yield str(tmp_path / "socket")
    server.stop(None).wait()


def asked(path, *fields, method=STOP):
    connection = urgent.begin_call(path, method, urgent.text_fields(*fields))
    return urgent.read_answer(connection)


@pytest.mark.parametrize("count", [0, 1, 200])  # up to more than a window of HTTP/2
def test_the_answer_is_the_librarys(path, count):
    answer = pb.StopResponse.FromString(asked(path, "", str(count)))
    assert len(answer.devices) == count
    assert all(report.fault_text == "x" * 1000 for report in answer.devices)


@pytest.mark.parametrize(("device", "caller"), [("", ""), ("arm", ""), ("", "ö"), ("a" * 32, "b")])
def test_a_message_of_texts_is_protobufs(device, caller):
    expected = pb.StopRequest(device=device, caller=caller)
    assert urgent.text_fields(device, caller) == expected.SerializeToString()
    assert (
        urgent.text_fields(device, caller)
        == pb.HaltRequest(device=device, caller=caller).SerializeToString()
    )


def test_a_text_that_is_too_long_is_refused():
    with pytest.raises(ValueError, match="at most 126 bytes"):
        urgent.text_fields("x" * 127)


def test_a_call_that_fails_has_no_answer(path):
    assert asked(path, "leg", "1") is None
    assert asked(path, "", "1", method="orientd.v1.Control/Sit") is None


def test_without_a_server_nothing_is_sent(tmp_path):
    assert urgent.begin_call(str(tmp_path / "none"), STOP, b"") is None
    assert urgent.begin_call("x" * 200, STOP, b"") is None


@pytest.mark.parametrize(
    "said",
    [
        b"",
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
        struct.pack(">HBBBL", 0, 8, 7, 0, 0) + bytes(8),  # GOAWAY
        struct.pack(">HBBBL", 0, 4, 3, 0, 1) + bytes(4),  # RST_STREAM
        struct.pack(">HBBBL", 0, 100, 0, 0, 1) + b"cut off",
        struct.pack(">HBBBL", 0, 5, 0, 1, 1) + bytes(5),  # no trailers
    ],
)
def test_what_is_no_answer_is_none(said):
    near, far = socket.socketpair()
    far.sendall(said)
    far.shutdown(socket.SHUT_WR)
    assert urgent.read_answer(near) is None
    far.close()
