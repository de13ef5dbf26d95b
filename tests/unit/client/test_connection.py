"""A client that has hung up, or never got through."""

import pytest
from authority import Authority

import orientd
from orientd.client.channel import Way, certificate_files
from orientd.client.robot import Robot
from orientd.errors import DaemonError
from orientd_fleet.client import connect_fleet


def test_what_is_called_wrongly_is_not_taken_for_a_closed_connection(tmp_path):
    robot = Robot(Way(tmp_path / "a.sock"), holder="ana", timeout=1.0)
    with pytest.raises(ValueError, match="rotation_vector") as caught:
        robot.plan([[0.1]])
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


def test_a_private_key_that_everybody_can_read_is_named(tmp_path, caplog):
    authority = Authority(tmp_path / "ca")
    authority.issue("ana")
    certificate, key, ca = (authority.folder / name for name in ("ana.pem", "ana.key", "ca.pem"))
    certificate_files("host:1", certificate, key, ca)
    assert not caplog.messages
    key.chmod(0o644)
    certificate_files("host:1", certificate, key, ca)
    assert caplog.messages == [
        f"every user can read the private key {key} (mode 644): chmod 600 it"
    ]


def test_a_socket_whose_name_looks_like_a_host_is_a_socket(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DaemonError) as caught:
        orientd.connect("localhost")
    assert str(caught.value) == "no daemon answers at localhost; start one with `orientd run`"
