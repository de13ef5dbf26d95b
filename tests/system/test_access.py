"""Permissions: every call by every role, over the Unix socket and over TCP."""

import json
import os
import signal
import socket
import ssl
import subprocess
import sys
import urllib.request

import grpc
import pytest
from access_cell import GROUP, MEMBER, OBSERVER, OPERATOR, STRANGER, Cell, as_user
from authority import OPENSSL
from browser import view_of
from command_line import assert_refused, begin, environment
from command_line import orientd as orientd_command
from every_call import SERVICE, walk
from harness import DaemonProcess, free_port, resident_kib, spin, until
from page import page_at

import orientd
from orientd.config import Role
from orientd.daemon.access.authorization import RULES
from orientd.errors import AccessError, DaemonError, LeaseError, RequestError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

pytestmark = pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here")

needs_root = pytest.mark.skipif(os.getuid() != 0, reason="becomes other users, which root may")


@pytest.fixture(autouse=True)
def held(cell):
    """Hold the lease, which nobody else renews."""
    cell.hold()


NEED_LEASE = {
    *("Move", "Track", "Pause", "Resume", "SetSpeed", "Enable", "Disable", "Reset"),
    *("RenewLease", "ReleaseLease"),
}


def check(codes, role):
    """Check what came of every call by somebody with *role* and without the lease."""
    assert set(codes) == {method.name for method in SERVICE.methods}
    for name, code in codes.items():
        if RULES[name].role > role:
            assert code == "PERMISSION_DENIED", name
        elif name in NEED_LEASE or name == "AcquireLease":
            assert code == "FAILED_PRECONDITION", name
        else:
            assert code == "OK", name


@needs_root
@pytest.mark.parametrize("has_token", [False, True], ids=["no token", "stolen token"])
@pytest.mark.parametrize(
    ("uid", "groups", "role"),
    [
        (OBSERVER, (), Role.OBSERVER),
        (OPERATOR, (), Role.OPERATOR),
        (MEMBER, (GROUP,), Role.OPERATOR),
        (OBSERVER, (GROUP,), Role.OPERATOR),
    ],
)
def test_users_do_what_their_role_permits_and_change_nothing(cell, uid, groups, role, has_token):
    before = cell.is_as()
    check(as_user(cell, uid, *groups, token=cell.daemon.token if has_token else ""), role)
    assert cell.is_as() == before


def test_without_roles_the_socket_is_the_users_alone(tmp_path):
    with DaemonProcess(tmp_path) as daemon:
        assert daemon.socket.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("has_token", [False, True], ids=["no token", "stolen token"])
@pytest.mark.parametrize(("name", "role"), [("watcher", Role.OBSERVER), ("pendant", Role.OPERATOR)])
def test_certificates_do_what_their_role_permits_and_change_nothing(cell, name, role, has_token):
    before = cell.is_as()
    with cell.channel(name) as channel:
        check(walk(channel, cell.daemon.token if has_token else ""), role)
    assert cell.is_as() == before


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("pendant", "other"),
        ("expired", "ca"),
        ("revoked", "ca"),
        ("listed", "ca"),
        ("unknown", "ca"),
        ("server", "ca"),
    ],
    ids=["wrong CA", "expired", "revoked", "serial listed", "no role", "not a client's"],
)
def test_certificates_that_do_not_count_get_no_answer(cell, name, folder):
    before = cell.is_as()
    with cell.channel(name, folder) as channel:
        codes = walk(channel, cell.daemon.token)
    assert set(codes.values()) == {"UNAVAILABLE"}
    assert cell.is_as() == before


def test_plain_text_and_no_certificate_get_no_answer(cell):
    before = cell.is_as()
    trusted = (cell.folder / "ca/ca.pem").read_bytes()
    bare = grpc.ssl_channel_credentials(trusted)
    for channel in (
        grpc.insecure_channel(cell.address),
        grpc.secure_channel(cell.address, bare),
    ):
        with channel:
            assert set(walk(channel, cell.daemon.token).values()) == {"UNAVAILABLE"}
    assert cell.is_as() == before


def handshake(cell, context):
    context.load_verify_locations(cell.folder / "ca/ca.pem")
    context.load_cert_chain(cell.folder / "ca/pendant.pem", cell.folder / "ca/pendant.key")
    context.set_alpn_protocols(["h2"])
    with (
        socket.create_connection(("127.0.0.1", cell.port), timeout=5.0) as plain,
        context.wrap_socket(plain, server_hostname="localhost") as secured,
    ):
        return secured.version()


def test_tls_is_1_3_and_nothing_before(cell):
    assert handshake(cell, ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)) == "TLSv1.3"
    old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    old.maximum_version = ssl.TLSVersion.TLSv1_2
    with pytest.raises((ssl.SSLError, ConnectionError)):
        handshake(cell, old)


def test_a_client_takes_no_daemon_of_another_authority(cell):
    files = cell.files("pendant") | {"ca": cell.folder / "other/ca.pem"}
    with pytest.raises(
        DaemonError,
        match=r"the certificate of the daemon at .* is refused: self.signed certificate",
    ):
        orientd.connect(address=cell.address, **files)


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("pendant", "other"),
        ("revoked", "ca"),
        ("server", "ca"),
        ("listed", "ca"),
        ("unknown", "ca"),
    ],
)
def test_a_certificate_that_is_not_admitted_is_told_so(cell, name, folder):
    files = cell.files(name, folder) | {"ca": cell.folder / "ca/ca.pem"}
    with pytest.raises(DaemonError, match=r"does not admit this certificate: .* its log says"):
        orientd.connect(address=cell.address, **files)


def test_a_client_says_that_its_own_certificate_has_expired(cell):
    files = cell.files("expired") | {"ca": cell.folder / "ca/ca.pem"}
    with pytest.raises(DaemonError, match=r"expired\.pem: the certificate in it expired on 2020-"):
        orientd.connect(address=cell.address, **files)


def test_the_daemon_records_why_it_has_refused_a_certificate(cell):
    with cell.channel("revoked") as channel:
        walk(channel, skip=[method.name for method in SERVICE.methods][1:])

    def refusals():
        return [one for one in cell.audit() if one["event"] == "refused"]

    until(lambda: "handshake: certificate revoked" in [one["text"] for one in refusals()], "it")
    assert {one["origin"].rpartition(":")[0] for one in refusals()} >= {"tcp, 127.0.0.1"}


def test_silent_handshakes_keep_nobody_out_and_take_no_memory(cell):
    before = resident_kib(cell.daemon.process.pid)
    silent = [socket.create_connection(("127.0.0.1", cell.port)) for _ in range(400)]
    try:
        with cell.robot("watcher", timeout=10.0) as robot:
            assert robot.state().daemon.pid == cell.daemon.process.pid
        assert resident_kib(cell.daemon.process.pid) - before <= 20 * 1024
    finally:
        for one in silent:
            one.close()


def test_a_name_that_there_is_not_and_no_daemon_are_told_apart(cell):
    with pytest.raises(DaemonError, match=r"no daemon listens at 127\.1:.*lookup failed"):
        orientd.connect(address=f"127.1:{cell.port}", **cell.files("pendant"))
    with pytest.raises(DaemonError, match=r"no daemon listens at 127.0.0.1:.*refused"):
        orientd.connect(address=f"127.0.0.1:{free_port()}", **cell.files("pendant"))


def test_a_host_that_the_certificate_of_the_daemon_does_not_name_is_told_so(cell):
    address = f"0.0.0.0:{cell.port}"  # this machine by another name
    with pytest.raises(DaemonError) as caught:
        orientd.connect(address=address, **cell.files("pendant"))
    assert str(caught.value).startswith(
        f"the certificate of the daemon at {address} is not for '0.0.0.0'; "
    )


def test_a_daemon_that_dies_is_no_refusal_of_the_certificate(tmp_path):
    cell = Cell(tmp_path)
    with cell.daemon, cell.robot("watcher") as robot:
        records = robot.observe().records()
        next(records)
        cell.daemon.process.kill()
        cell.daemon.process.wait()
        with pytest.raises(DaemonError) as caught:
            list(records)
        assert str(caught.value) == f"lost the daemon at {cell.address}"


@needs_root
def test_a_user_who_is_not_admitted_is_told_so(cell):
    program = (
        # What a call imports may lie where the user to become cannot look.
        f"import os, orientd; orientd.connect({str(cell.daemon.socket)!r}).close()\n"
        f"os.setgroups([]); os.setgid({STRANGER}); os.setuid({STRANGER})\n"
        f"orientd.connect({str(cell.daemon.socket)!r})"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert f"user {STRANGER} is not admitted" in done.stderr.splitlines()[-1]


@pytest.fixture
def free(cell):
    """Give the cell's lease back, and hold it again in the end."""
    stub = cell.daemon.stub
    stub.ReleaseLease(pb.ReleaseLeaseRequest(token=cell.daemon.token))
    yield
    until(lambda: not stub.GetState(pb.GetStateRequest()).daemon.leases, "the lease", 40.0)
    answer = stub.AcquireLease(pb.AcquireLeaseRequest(holder="test"))
    cell.daemon.token = answer.lease.token


def test_an_operator_moves_over_tcp(cell, free):
    with cell.robot("pendant") as robot:
        report = robot.move([{"rotation_vector": [0.0, 0.0, 0.1]}], approach=True).wait(20.0)
        assert report.outcome == pb.OUTCOME_DONE
        assert robot.state().daemon.leases[0].identity == "certificate:pendant"
        with pytest.raises(AccessError, match="SeizeLease needs the role administrator"):
            robot.seize_lease("impatience")


def test_a_token_is_of_no_use_to_others(cell, free):
    with cell.robot("pendant") as robot, cell.robot("chief") as chief:
        robot.acquire_lease()
        with pytest.raises(LeaseError, match=r"held by 'pendant' \(certificate:pendant\)"):
            chief.acquire_lease(beside=True)
        connection, request = chief._connection, pb.RenewLeaseRequest(token=robot.lease_token)
        with pytest.raises(LeaseError, match="its token is of no use to certificate:chief"):
            connection.ask(connection.stub.RenewLease, request)
        robot.enable()

    def is_told():
        return [
            record
            for record in cell.audit()
            if (record.get("method"), record.get("identity")) == ("RenewLease", "certificate:chief")
        ]

    assert until(is_told, "the record")[-1]["outcome"] == "FAILED_PRECONDITION"


def test_an_administrator_seizes_the_lease_and_what_ran_stops(cell, free):
    with cell.robot("pendant") as robot, cell.robot("chief") as chief:
        motion = robot.move(
            [
                {"time": 0.0, "rotation_vector": [0.0, 0.0, 0.1]},
                {"time": 9.0, "rotation_vector": [0.3, 0.0, 0.1]},
            ],
            approach=True,
        )
        with pytest.raises(RequestError, match="why the lease is seized"):
            chief.seize_lease("")
        chief.seize_lease("arm in the way")
        summary = motion.wait(20.0, check=False)
        assert (summary.outcome, summary.text) == (
            pb.OUTCOME_STOPPED,
            "the lease of pendant (certificate:pendant) was seized by chief (certificate:chief): "
            "arm in the way",
        )
        chief.enable()
    records = [record for record in cell.audit() if record.get("method") == "SeizeLease"]
    assert records[-1]["identity"] == "certificate:chief"


def test_commands_and_refusals_are_recorded_without_secrets(cell):
    stub, token = cell.daemon.stub, cell.daemon.token
    stub.SetSpeed(pb.SetSpeedRequest(lease_token=token, speed=0.9))
    stub.SetSpeed(pb.SetSpeedRequest(lease_token=token, speed=1.0))
    motion = json.dumps({**json.loads(spin(1.0)), "name": "swing"}).encode()
    *_, last = cell.daemon.move(motion)
    assert last.summary.outcome == pb.OUTCOME_DONE
    with cell.channel("watcher") as channel:
        walk(channel, token)

    def mine(event, method, identity):
        return [
            record
            for record in cell.audit()
            if (record["event"], record.get("method"), record.get("identity"))
            == (event, method, identity)
        ]

    me = f"user:{os.getuid()}"
    until(lambda: mine("answered", "Enable", "certificate:watcher"), "the records")
    speed = mine("answered", "SetSpeed", me)[-1]
    assert (speed["request"], speed["outcome"]) == ({"speed": 1.0}, "OK")
    moved = until(lambda: mine("answered", "Move", me), "the record")[-1]
    assert (moved["motion"], moved["motion_outcome"]) == (
        last.summary.motion_number,
        "OUTCOME_DONE",
    )
    asked = moved["request"]["motion"]
    assert (asked["name"], asked["bytes"]) == ("swing", len(motion))
    refused = mine("answered", "Enable", "certificate:watcher")[-1]
    assert refused["outcome"] == "PERMISSION_DENIED"
    assert refused["role"] == "observer"
    texts = [path.read_text() for path in (cell.folder / "state").rglob("*") if path.is_file()]
    texts.append((cell.folder / "log").read_text())
    assert not [text for text in texts if token in text]


def test_the_audit_log_is_the_users_alone(cell):
    path = cell.folder / "state/orientd/audit.jsonl"
    assert path.stat().st_mode & 0o777 == 0o600


def test_the_command_line_reaches_a_daemon_over_tcp(cell):
    files = cell.files("watcher")
    remote = ["--address", cell.address, "--cert", files["certificate"], "--key", files["key"]]
    done = orientd_command("status", "--json", *remote, "--ca", files["ca"])
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["daemon"]["pid"] == cell.daemon.process.pid
    done = orientd_command("lease", "seize", "--reason", "x", *remote, "--ca", files["ca"])
    assert done.returncode == 1
    assert "SeizeLease needs the role administrator" in done.stderr


def test_the_environment_names_a_daemon_and_a_certificate(cell):
    files = cell.files("watcher")
    named = environment(
        ORIENTD_ADDRESS=cell.address, ORIENTD_CERT=str(files["certificate"]),
        ORIENTD_KEY=str(files["key"]), ORIENTD_CA=str(files["ca"]),
    )  # fmt: skip
    done = orientd_command("status", "--json", env=named)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["daemon"]["pid"] == cell.daemon.process.pid


def test_a_view_with_an_observers_certificate_shows_and_stops_and_commands_nothing(cell):
    pytest.importorskip("websockets")
    before, files = cell.is_as(), cell.files("watcher")
    there = ("--address", cell.address, "--ca", files["ca"])
    own = ("--cert", files["certificate"], "--key", files["key"])
    refusal = "needs the role operator, watcher (certificate:watcher) is observer"
    with view_of(None, *there, *own) as view, page_at(view.address) as page:
        page.await_line("Holding")
        page.ask("lease")
        page.await_refusal(refusal)
        page.ask("speed", percent=50)
        page.await_refusal("take the lease first")
        page.answers.clear()
        page.ask("stop")
        page.until(lambda page: page.answers, "the answer")
        assert page.answers == [{"answered": "stop"}]
    assert cell.is_as() == before


def test_the_view_reaches_a_daemon_over_tcp_with_a_certificate_alone(cell):
    pytest.importorskip("websockets")
    files = cell.files("watcher")
    there = ("--address", cell.address, "--ca", files["ca"], "--no-open", "--port", 0)
    own = ("--cert", files["certificate"], "--key", files["key"])
    view = begin("view", *there, *own)
    line = view.stdout.readline()
    assert line.startswith("ready at http://127.0.0.1:"), (line, view.stderr.read())
    with urllib.request.urlopen(line.split()[-1]) as page:
        assert b"<html" in page.read()
    view.terminate()
    rest, errors = view.communicate(timeout=15.0)
    assert (view.returncode, rest, errors) == (0, "", "")
    revoked = cell.files("revoked")
    done = orientd_command(
        "view", *there, "--cert", revoked["certificate"], "--key", revoked["key"]
    )
    assert_refused(done, "does not admit this certificate")


def test_a_reload_keeps_the_certificate_if_the_new_one_has_expired(cell):
    ca = cell.folder / "ca"
    kept = {name: (ca / name).read_bytes() for name in ("server.pem", "server.key")}
    try:
        for name in kept:
            (ca / name).write_bytes((ca / name.replace("server", "expired")).read_bytes())
        cell.daemon.process.send_signal(signal.SIGHUP)
        said = f"nothing changed: tcp.certificate: {ca}/server.pem: the certificate in it expired"
        until(lambda: said in (cell.folder / "log").read_text(), "the refusal")
    finally:
        for name, content in kept.items():
            (ca / name).write_bytes(content)
    with cell.robot("pendant") as robot:
        assert robot.devices()


def test_a_revocation_counts_at_once_and_for_the_one_revoked_alone(cell):
    def reload():
        told = (cell.folder / "log").read_text().count("reload: changed")
        cell.daemon.process.send_signal(signal.SIGHUP)
        until(lambda: (cell.folder / "log").read_text().count("reload: changed") > told, "it")

    with cell.channel("watcher") as channel:
        stream = control_stub(channel).WatchState(pb.WatchStateRequest())
        next(stream)
        reload()
        next(stream)
        cell.authority.revoke("watcher")
        reload()
        with pytest.raises(grpc.RpcError) as caught:
            list(stream)
        assert caught.value.code() is grpc.StatusCode.UNAVAILABLE
    with cell.channel("watcher") as channel:
        assert set(walk(channel).values()) == {"UNAVAILABLE"}
    with cell.robot("chief") as robot:
        assert robot.devices()


def test_a_role_that_is_taken_away_counts_at_once(cell):
    with cell.channel("chief") as channel:
        stream = control_stub(channel).WatchState(pb.WatchStateRequest())
        next(stream)
        text = cell.daemon.config.read_text()
        cell.daemon.config.write_text(text.replace("chief = 'administrator'\n", ""))
        cell.daemon.process.send_signal(signal.SIGHUP)
        with pytest.raises(grpc.RpcError) as caught:
            list(stream)
        assert caught.value.code() is grpc.StatusCode.UNAVAILABLE
    refused = {"event": "refused", "text": "chief is admitted no more"}
    until(lambda: any(refused.items() <= one.items() for one in cell.audit()), "the audit's line")
