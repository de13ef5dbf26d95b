"""The certificates that config/ca.cnf makes, judged by OpenSSL's own program."""

import subprocess

import pytest
from authority import OPENSSL, Authority

pytestmark = pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here")


def verdict(folder, name, purpose):
    arguments = ["verify", "-CAfile", "ca.pem", "-CRLfile", "crl.pem", "-crl_check"]
    arguments += ["-x509_strict", "-purpose", purpose, f"{name}.pem"]
    done = subprocess.run(
        [OPENSSL, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr


def test_what_is_signed_is_good_for_what_it_is_for_until_it_is_revoked(tmp_path):
    folder = tmp_path / "ca"
    authority = Authority(folder)
    authority.issue("pendant")
    authority.issue("server", hosts="IP:127.0.0.1,DNS:cell.local")
    authority.expired("old")
    assert "pendant.pem: OK" in verdict(folder, "pendant", "sslclient")
    assert "server.pem: OK" in verdict(folder, "server", "sslserver")
    assert "unsuitable certificate purpose" in verdict(folder, "pendant", "sslserver")
    assert "certificate has expired" in verdict(folder, "old", "sslclient")
    authority.revoke("pendant")
    assert "certificate revoked" in verdict(folder, "pendant", "sslclient")
    assert "server.pem: OK" in verdict(folder, "server", "sslserver")
    for name in ("ca", "pendant", "server"):
        assert (folder / f"{name}.key").stat().st_mode & 0o077 == 0
