"""A daemon with roles for users and certificates, and the authorities of those."""

import json
import subprocess
import sys
from pathlib import Path

import grpc
from authority import Authority
from harness import DaemonProcess, free_port

import orientd
from orientd.protocol import control_pb2 as pb

OBSERVER, OPERATOR, MEMBER, STRANGER = 54301, 54302, 54303, 54304
GROUP = 54399


class Cell:
    """A daemon with roles for users and certificates, and an authority that signed those."""

    def __init__(self, folder):
        self.folder = folder
        self.authority = Authority(folder / "ca")
        self.other = Authority(folder / "other")
        self.authority.issue("server", hosts="IP:127.0.0.1,DNS:localhost")
        for name in ("watcher", "pendant", "chief", "revoked", "listed", "unknown"):
            self.authority.issue(name)
        self.authority.expired("expired")
        self.authority.revoke("revoked")
        for name in ("pendant", "server"):
            self.other.issue(name)
        self.port = free_port()
        self.daemon = DaemonProcess(folder, lease=30.0)
        text = self.daemon.config.read_text()
        names = ("pendant", "revoked", "listed", "expired", "server", "early")
        ca = folder / "ca"
        self.daemon.config.write_text(
            f"[access.users]\n{OBSERVER} = 'observer'\n{OPERATOR} = 'operator'\n"
            f"[access.groups]\n{GROUP} = 'operator'\n"
            "[access.certificates]\nwatcher = 'observer'\nchief = 'administrator'\n"
            + "".join(f"{name} = 'operator'\n" for name in names)
            + f"[tcp]\nlisten = '127.0.0.1:{self.port}'\ncertificate = '{ca}/server.pem'\n"
            f"key = '{ca}/server.key'\nca = '{ca}/ca.pem'\ncrl = '{ca}/crl.pem'\n"
            f"revoked = ['{self.authority.serial('listed')}']\n" + text
        )

    @property
    def address(self):
        return f"127.0.0.1:{self.port}"

    def files(self, name, folder="ca"):
        ca = self.folder / folder
        return {"certificate": ca / f"{name}.pem", "key": ca / f"{name}.key", "ca": ca / "ca.pem"}

    def channel(self, name, folder="ca"):
        files = self.files(name, folder)
        trusted = (self.folder / "ca/ca.pem").read_bytes()
        credentials = grpc.ssl_channel_credentials(
            trusted, files["key"].read_bytes(), files["certificate"].read_bytes()
        )
        return grpc.secure_channel(self.address, credentials)

    def robot(self, name, **more):
        return orientd.connect(address=self.address, holder=name, **self.files(name), **more)

    def audit(self):
        path = self.folder / "state/orientd/audit.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()]

    def hold(self):
        """Renew the lease for its full time, or acquire it again if it has expired."""
        stub = self.daemon.stub
        try:
            stub.RenewLease(pb.RenewLeaseRequest(token=self.daemon.token))
        except grpc.RpcError:
            answer = stub.AcquireLease(pb.AcquireLeaseRequest(holder="test"))
            self.daemon.token = answer.lease.token

    def is_as(self):
        """Return everything that a call without the right to it must not change."""
        device = self.daemon.device()
        answer = self.daemon.stub.GetState(pb.GetStateRequest())
        return (
            device.state,
            device.speed,
            device.motion_number,
            device.is_paused,
            device.servo_pid,
            device.cycle.q,
            [(lease.holder, lease.identity) for lease in answer.daemon.leases],
        )


def as_user(cell, uid, *groups, token=""):
    """Return what came of every call by a process of *uid*."""
    program = Path(__file__).with_name("every_call.py")
    arguments = [cell.daemon.socket, token, uid, uid, *groups]
    done = subprocess.run(
        [sys.executable, str(program), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
