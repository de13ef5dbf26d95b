"""A client that has hung up, or never got through."""

import pytest
from authority import Authority

import orientd
from orientd.client.channel import Way, certificate_files
from orientd.client.robot import Robot
from orientd.errors import DaemonError
from orientd_fleet import connect_fleet

AIM = [{"rotation_vector": [0.1, 0.0, 0.0]}]

CALLS = {
    "state": lambda robot: robot.state(),
    "watch": lambda robot: next(robot.watch()),
    "observe": lambda robot: robot.observe().configuration(),
    "records": lambda robot: next(robot.observe().records()),
    "plan": lambda robot: robot.plan(AIM),
    "move": lambda robot: robot.move(AIM),
    "track": lambda robot: robot.track(),
    "stop": lambda robot: robot.stop(),
    "enable": lambda robot: robot.enable(),
    "lease": lambda robot: robot.acquire_lease(beside=True),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_closed_client_says_that_it_is_closed(tmp_path, name):
    robot = Robot(Way(tmp_path / "a.sock"), holder="ana", timeout=1.0)
    robot.close()
    robot.close()
    with pytest.raises(DaemonError) as caught:
        CALLS[name](robot)
    assert str(caught.value) == f"the connection to {tmp_path}/a.sock is closed"


def test_what_is_called_wrongly_is_not_taken_for_a_closed_connection(tmp_path):
    robot = Robot(Way(tmp_path / "a.sock"), holder="ana", timeout=1.0)
    with pytest.raises(ValueError, match="rotation_vector") as caught:
        robot.plan([{"rotation_vector": [0.1]}])
    assert not isinstance(caught.value, DaemonError)
    robot.close()


@pytest.mark.parametrize(
    ("connect_to", "address"),
    [(orientd.connect, {"address": "host:1"}), (connect_fleet, {"connect": "tls/host:1"})],
)
def test_what_is_missing_of_the_certificates_is_named(monkeypatch, connect_to, address):
    for name in ("ORIENTD_CERT", "ORIENTD_KEY", "ORIENTD_CELL"):
        monkeypatch.setenv(name, "here")
    monkeypatch.delenv("ORIENTD_CA", raising=False)
    with pytest.raises(
        DaemonError, match=r"host:1 needs a certificate.* environment's ORIENTD_CA$"
    ):
        connect_to(**address)


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    made = Authority(tmp_path_factory.mktemp("authority") / "ca")
    for name in ("ana", "bob"):
        made.issue(name)
    return made


def client_files(authority, *names):
    return certificate_files("host:1", *(authority.folder / name for name in names))


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        (("ana.pem", "bob.key", "ca.pem"), "the key {1} does not belong to the certificate {0}"),
        (
            ("ana.key", "ana.key", "ca.pem"),
            "{0}: expected a certificate in PEM, found a private key",
        ),
        (
            ("ana.pem", "ana.key", "ana.key"),
            "{2}: expected a certificate in PEM, found a private key",
        ),
        (
            ("ana.pem", "ana.pem", "ca.pem"),
            "{1}: expected a private key in PEM, found a certificate",
        ),
        (("ana.pem", "none", "ca.pem"), "cannot read {1}: No such file or directory"),
    ],
    ids=["another's key", "no certificate", "no CA", "no key", "no file"],
)
def test_a_wrong_file_of_a_client_is_named_before_it_connects(authority, names, problem):
    paths = [authority.folder / name for name in names]
    with pytest.raises(DaemonError) as caught:
        client_files(authority, *names)
    assert str(caught.value).startswith(problem.format(*paths))


def test_a_private_key_that_everybody_can_read_is_named(authority, caplog):
    client_files(authority, "ana.pem", "ana.key", "ca.pem")
    assert not caplog.messages
    key = authority.folder / "open.key"
    key.write_bytes((authority.folder / "ana.key").read_bytes())
    key.chmod(0o644)
    client_files(authority, "ana.pem", "open.key", "ca.pem")
    assert caplog.messages == [
        f"every user can read the private key {key} (mode 644): chmod 600 it"
    ]


def test_a_socket_whose_name_looks_like_a_host_is_a_socket(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DaemonError) as caught:
        orientd.connect("localhost")
    assert str(caught.value) == "no daemon answers at localhost; start one with `orientd run`"
