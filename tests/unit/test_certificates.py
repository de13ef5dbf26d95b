"""The cell's own authority, judged by OpenSSL's own program."""

import shutil
import subprocess

import pytest

from orientd.errors import ConfigError

certificates = pytest.importorskip("orientd.certificates")
OPENSSL = shutil.which("openssl")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "ca"


@pytest.fixture
def authority(folder):
    return certificates.Authority.make(folder, "cell")


def verdict(folder, name, purpose):
    arguments = ["verify", "-CAfile", folder / "ca.pem", "-CRLfile", folder / "crl.pem"]
    arguments += ["-crl_check", "-x509_strict", "-purpose", purpose, folder / f"{name}.pem"]
    done = subprocess.run(
        [OPENSSL, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr


@pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here")
def test_openssl_takes_what_is_signed_for_what_it_is_for(authority, folder):
    authority.issue("pendant", days=1)
    authority.issue("server", days=1, hosts=["127.0.0.1", "cell.local"])
    authority.issue("old", days=-1)
    assert "pendant.pem: OK" in verdict(folder, "pendant", "sslclient")
    assert "server.pem: OK" in verdict(folder, "server", "sslserver")
    assert "unsuitable certificate purpose" in verdict(folder, "pendant", "sslserver")
    assert "certificate has expired" in verdict(folder, "old", "sslclient")
    authority.revoke("pendant")
    assert "certificate revoked" in verdict(folder, "pendant", "sslclient")
    assert "server.pem: OK" in verdict(folder, "server", "sslserver")


def test_keys_are_their_owners_alone(authority, folder):
    issued = authority.issue("pendant", days=1)
    for path in (folder / "ca.key", issued.key):
        assert path.stat().st_mode & 0o777 == 0o600


def test_what_was_signed_and_revoked_is_listed(authority):
    authority.issue("pendant", days=1)
    authority.issue("server", days=1, hosts=["localhost"])
    revoked = authority.revoke("pendant")
    assert authority.revoke("pendant") == revoked
    assert [(one.name, one.is_server, one.is_revoked) for one in authority.issued()] == [
        ("pendant", False, True),
        ("server", True, False),
    ]


def test_nothing_is_overwritten(authority, folder):
    with pytest.raises(ConfigError, match="has an authority already"):
        certificates.Authority.make(folder, "again")
    authority.issue("pendant", days=1)
    with pytest.raises(ConfigError, match="is there already"):
        authority.issue("pendant", days=1)


@pytest.mark.parametrize("name", ["", "ca", "crl", "../up", ".hidden", "x" * 65])
def test_names_that_cannot_be_files_are_refused(authority, name):
    with pytest.raises(ConfigError, match="expected a name"):
        authority.issue(name, days=1)


def test_where_there_is_no_authority_that_is_said(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read .*\.pem: No such file"):
        certificates.Authority(tmp_path)
