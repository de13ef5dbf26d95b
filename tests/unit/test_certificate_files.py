"""Wrong certificate files: daemon and client name the file, what is in it, and the next step."""

import subprocess
from pathlib import Path

import pytest
from authority import OPENSSL, Authority

from orientd.client.channel import certificate_files
from orientd.config import TcpSettings
from orientd.daemon.access.listener import server_context
from orientd.errors import ConfigError, DaemonError

pytestmark = pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here")

# Which file of a daemon is replaced by which, and the line about it.
WRONG = {
    "no certificate there": (
        {"certificate": "none.pem"},
        "tcp.certificate: cannot read {}/none.pem: No such file or directory",
    ),
    "no key there": (
        {"key": "none.key"},
        "tcp.key: cannot read {}/none.key: No such file or directory",
    ),
    "a folder": ({"ca": "folder"}, "tcp.ca: cannot read {}/folder: Is a directory"),
    "the key of another certificate": (
        {"key": "pendant.key"},
        "tcp.key: the key {0}/pendant.key does not belong to the certificate {0}/server.pem",
    ),
    "a certificate that has expired": (
        {"certificate": "old.pem", "key": "old.key"},
        "tcp.certificate: {}/old.pem: the certificate in it expired on 2020-01-02 00:00 UTC; "
        "have the authority sign a new one",
    ),
    "certificate and key swapped": (
        {"certificate": "server.key", "key": "server.pem"},
        "tcp.certificate: {}/server.key: expected a certificate in PEM, found a private key; "
        "give the file of the right kind",
    ),
    "a request in place of a certificate": (
        {"certificate": "server.csr"},
        "tcp.certificate: {}/server.csr: expected a certificate in PEM, found a request for a "
        "certificate; give the file of the right kind",
    ),
    "a certificate in DER": (
        {"certificate": "server.der"},
        "tcp.certificate: {0}/server.der: expected a certificate in PEM, found DER; "
        "convert it with `openssl x509 -inform DER -in {0}/server.der -out NEW`",
    ),
    "a key with a password": (
        {"key": "locked.key"},
        "tcp.key: {0}/locked.key: expected a private key without a password; "
        "remove the password with `openssl pkey -in {0}/locked.key -out NEW`",
    ),
    "a public key": (
        {"key": "public.key"},
        "tcp.key: {}/public.key: expected a private key in PEM, found a public key; "
        "give the file of the right kind",
    ),
    "an empty file": (
        {"certificate": "empty.pem"},
        "tcp.certificate: {}/empty.pem: expected a certificate in PEM, found an empty file; "
        "write it again",
    ),
    "a text": (
        {"ca": "text.pem"},
        "tcp.ca: {}/text.pem: expected a certificate in PEM, found no PEM; "
        "give a file with a line -----BEGIN ...-----",
    ),
    "a key that is cut off": (
        {"key": "cut.key"},
        "tcp.key: {}/cut.key: the private key in it is damaged; copy it again",
    ),
    "a list as the authority": (
        {"ca": "crl.pem"},
        "tcp.ca: {}/crl.pem: expected a certificate in PEM, found a list of revoked certificates; "
        "give the file of the right kind",
    ),
    "a certificate that signs no others": (
        {"ca": "pendant.pem"},
        "tcp.ca: {}/pendant.pem: expected the certificate of an authority, found one that signs no "
        "others; give the file that signed the other end",
    ),
    "an authority as the list": (
        {"crl": "ca.pem"},
        "tcp.crl: {}/ca.pem: expected a list of revoked certificates in PEM, found a certificate; "
        "give the file of the right kind",
    ),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of files that are what they should be, and of others."""
    folder = tmp_path_factory.mktemp("authority") / "ca"
    made = Authority(folder)
    made.issue("pendant")
    made.issue("server", hosts="IP:127.0.0.1")
    made.expired("old")

    def openssl(*arguments):
        subprocess.run([OPENSSL, *arguments], cwd=folder, check=True, capture_output=True)

    openssl("x509", "-in", "server.pem", "-outform", "DER", "-out", "server.der")
    openssl("pkey", "-in", "server.key", "-aes256", "-passout", "pass:x", "-out", "locked.key")
    openssl("pkey", "-in", "server.key", "-pubout", "-out", "public.key")
    (folder / "empty.pem").write_text("")
    (folder / "text.pem").write_text("the certificate is with ana\n")
    (folder / "folder").mkdir()
    key = (folder / "server.key").read_text()
    (folder / "cut.key").write_text(f"{key[: len(key) // 2]}\n")
    return folder


def files(folder, replaced):
    """Return the files of a daemon, some of them replaced."""
    good = {"certificate": "server.pem", "key": "server.key", "ca": "ca.pem", "crl": "crl.pem"}
    return {name: Path(folder, file) for name, file in {**good, **replaced}.items()}


@pytest.mark.parametrize("name", WRONG)
def test_a_daemon_names_a_wrong_file_by_its_setting(folder, name):
    replaced, line = WRONG[name]
    with pytest.raises(ConfigError) as caught:
        server_context(TcpSettings(listen="127.0.0.1:0", **files(folder, replaced)))
    assert str(caught.value) == line.format(folder)


@pytest.mark.parametrize("name", [name for name in WRONG if "crl" not in WRONG[name][0]])
def test_a_client_names_a_wrong_file_before_it_connects(folder, name):
    replaced, line = WRONG[name]
    given = files(folder, replaced)
    with pytest.raises(DaemonError) as caught:
        certificate_files("host:1", given["certificate"], given["key"], given["ca"])
    assert str(caught.value) == line.format(folder).partition(": ")[2]


def test_files_that_are_as_they_should_be_are_taken(folder):
    given = files(folder, {})
    server_context(TcpSettings(listen="127.0.0.1:0", **given))
    certificate_files("host:1", given["certificate"], given["key"], given["ca"])
