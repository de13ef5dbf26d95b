"""Strangers: each kind of caller that must not command, and that nothing changes by it."""

import os
import socket
import ssl
from functools import partial

import grpc
import pytest
from access_cell import OPERATOR, STRANGER, as_user
from authority import OPENSSL, QUICK_KEY
from motions import through

from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

pytestmark = pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here")

needs_root = pytest.mark.skipif(os.getuid() != 0, reason="becomes other users, which root may")

UNHEARD = {"UNAVAILABLE"}
"""What comes of calls that the daemon does not even answer."""

TURN = through([(0.2, 0, 0)])


@pytest.fixture(autouse=True)
def unchanged(cell):
    """Check that whoever comes in a test changes nothing that the daemon's own user holds."""
    cell.hold()
    before = cell.is_as()
    yield
    assert cell.is_as() == before


# Users of the machine


@needs_root
@pytest.mark.parametrize("has_token", [False, True], ids=["", "with a stolen token"])
@pytest.mark.parametrize(
    ("uid", "groups"),
    [(STRANGER, ()), (STRANGER, (54388, 54389)), (STRANGER, (OPERATOR,))],
    ids=["without a role", "in other groups", "in a group with the number of an admitted user"],
)
def test_a_user_is_not_heard(cell, uid, groups, has_token):
    codes = as_user(cell, uid, *groups, token=cell.daemon.token if has_token else "")
    assert set(codes.values()) == UNHEARD


# Tokens


def ended(cell, how):
    """Return the token of a lease that has ended, with another one in its place."""
    stub, token = cell.daemon.stub, cell.daemon.token
    if how == "released":
        stub.ReleaseLease(pb.ReleaseLeaseRequest(token=token))
        lease = stub.AcquireLease(pb.AcquireLeaseRequest(holder="test")).lease
    else:
        lease = stub.SeizeLease(pb.SeizeLeaseRequest(holder="test", reason="a test")).lease
    cell.daemon.token = lease.token
    return token


TOKENS = {
    "none": lambda cell: "",
    "nonsense": lambda cell: "nonsense",
    "no ASCII": lambda cell: "é" * 32,
    "cut short": lambda cell: cell.daemon.token[:-1],
    "with more behind it": lambda cell: cell.daemon.token + "0",
    "in capitals": lambda cell: cell.daemon.token.upper() + "A",
    "very long": lambda cell: "0" * 100_000,
    "released": partial(ended, how="released"),
    "seized": partial(ended, how="seized"),
}


@pytest.mark.parametrize("kind", TOKENS)
def test_a_token_that_is_none_moves_nothing(cell, kind):
    request = pb.MoveRequest(lease_token=TOKENS[kind](cell), motion=TURN, device="arm")
    with pytest.raises(grpc.RpcError) as caught:
        list(cell.daemon.stub.Move(request))
    assert caught.value.code() is grpc.StatusCode.FAILED_PRECONDITION


@pytest.mark.parametrize("kind", ["released", "seized"])
def test_the_token_of_a_lease_that_has_ended_is_not_renewed(cell, kind):
    with pytest.raises(grpc.RpcError, match="the lease is held by 'test'") as caught:
        cell.daemon.stub.RenewLease(pb.RenewLeaseRequest(token=TOKENS[kind](cell)))
    assert caught.value.code() is grpc.StatusCode.FAILED_PRECONDITION


@pytest.mark.parametrize(
    ("name", "request_"),
    [
        ("Enable", lambda token: pb.CommandRequest(lease_token=token)),
        ("RenewLease", lambda token: pb.RenewLeaseRequest(token=token)),
        ("ReleaseLease", lambda token: pb.ReleaseLeaseRequest(token=token)),
        ("Move", lambda token: pb.MoveRequest(lease_token=token, motion=TURN)),
        ("AcquireLease", lambda token: pb.AcquireLeaseRequest(holder="thief", beside=True)),
        ("Move", lambda token: pb.MoveRequest(holder="thief", beside=True, motion=TURN)),
    ],
    ids=["commands", "renews", "releases", "moves", "commands beside it", "moves beside it"],
)
def test_an_operator_with_anothers_token_is_refused(cell, name, request_):
    with cell.channel("pendant") as channel:
        answer = getattr(control_stub(channel), name)
        with pytest.raises(grpc.RpcError) as caught:
            for _ in (
                [answer(request_(cell.daemon.token))]
                if name != "Move"
                else answer(request_(cell.daemon.token))
            ):
                pass
    assert caught.value.code() is grpc.StatusCode.FAILED_PRECONDITION


# Certificates


def self_signed(cell, name):
    subject = ("-subj", "/CN=pendant", "-days", "9")
    files = ("-keyout", f"{name}.key", "-out", f"{name}.pem")
    cell.authority.run("req", "-x509", *subject, *QUICK_KEY, *files)


def signed_by_a_client(cell, name):
    files = ("-keyout", f"{name}.key", "-out", f"{name}.csr")
    cell.authority.run("req", "-new", "-subj", "/CN=pendant", *QUICK_KEY, *files)
    cell.authority.run(
        "x509", "-req", "-in", f"{name}.csr", "-CA", "watcher.pem", "-CAkey", "watcher.key",
        "-days", "9", "-out", f"{name}.pem",
    )  # fmt: skip


def named(subject, **more):
    return lambda cell, name: cell.authority.issue(name, subject=subject, **more)


CERTIFICATES = {
    "self-signed with an admitted name": self_signed,
    "signed by an admitted client": signed_by_a_client,
    "not valid yet": named(
        "/CN=early", dates=("-startdate", "20400101000000Z", "-enddate", "20410101000000Z")
    ),
    "with another case of an admitted name": named("/CN=Pendant"),
    "with a blank after an admitted name": named("/CN=pendant "),
    "with two names, an admitted one first": named("/CN=pendant/CN=chief"),
    "with two names, an admitted one last": named("/CN=nobody/CN=pendant"),
    "with an admitted name as alternative only": named("/CN=nobody", alternative="DNS:pendant"),
    "with a longer name": named("/CN=pendant2"),
}


@pytest.mark.parametrize("kind", CERTIFICATES)
def test_a_certificate_is_not_heard_that_is(cell, kind):
    name = f"stranger{list(CERTIFICATES).index(kind)}"
    CERTIFICATES[kind](cell, name)
    with cell.channel(name) as channel:
        assert code_of(channel) == "UNAVAILABLE"


def code_of(channel):
    """Return the status of a look and of a command."""
    codes = set()
    for call, request in (
        (control_stub(channel).GetState, pb.GetStateRequest()),
        (control_stub(channel).Enable, pb.CommandRequest()),
    ):
        try:
            call(request, timeout=20.0)
        except grpc.RpcError as error:
            codes.add(error.code().name)
        else:
            codes.add("OK")
    (code,) = codes
    return code


@pytest.mark.parametrize("kind", ["HTTP/1.1", "another protocol by ALPN"])
def test_an_admitted_certificate_is_not_heard_over(cell, kind):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(cell.folder / "ca/ca.pem")
    files = cell.files("pendant")
    context.load_cert_chain(files["certificate"], files["key"])
    context.set_alpn_protocols(["http/1.1" if kind == "another protocol by ALPN" else "h2"])
    answer = b""
    with socket.create_connection(("127.0.0.1", cell.port), timeout=10.0) as plain:
        try:
            with context.wrap_socket(plain, server_hostname="localhost") as secured:
                secured.sendall(b"POST /orientd.v1.Control/Enable HTTP/1.1\r\nHost: x\r\n\r\n")
                while piece := secured.recv(4096):
                    answer += piece
        except (ssl.SSLError, ConnectionError):
            pass
    assert b"200" not in answer
    assert b"grpc-status" not in answer
