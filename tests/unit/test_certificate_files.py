"""Wrong certificate files: daemon and client name the file, what is in it, and the next step."""

import ssl
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
        "tcp.certificate: cannot read {}/none.pem: No such file or directory; check the path",
    ),
    "no key there": (
        {"key": "none.key"},
        "tcp.key: cannot read {}/none.key: No such file or directory; check the path",
    ),
    "a folder": (
        {"ca": "folder"},
        "tcp.ca: cannot read {}/folder: Is a directory; give a file in it",
    ),
    "the key of another certificate": (
        {"key": "pendant.key"},
        "tcp.key: the key {0}/pendant.key does not belong to the certificate {0}/server.pem; "
        "give the key that was made with it",
    ),
    "a certificate that has expired": (
        {"certificate": "old.pem", "key": "old.key"},
        "tcp.certificate: {}/old.pem: the certificate in it expired on 2020-01-02 00:00 UTC; "
        "have the authority sign a new one",
    ),
    "a certificate that does not count yet": (
        {"certificate": "new.pem", "key": "new.key"},
        "tcp.certificate: {}/new.pem: the certificate in it counts from 2090-01-01 00:00 UTC; "
        "set the clock of this machine, or have the authority sign a new one",
    ),
    "an authority that has expired": (
        {"ca": "oldca.pem"},
        "tcp.ca: {}/oldca.pem: the authority in it expired on 2020-01-02 00:00 UTC; "
        "make a new one, and have it sign the certificates",
    ),
    "a list that has expired": (
        {"crl": "oldcrl.pem"},
        "tcp.crl: {}/oldcrl.pem: the list in it expired on 2020-01-02 00:00 UTC; "
        "have the authority sign a new one",
    ),
    "a list of another authority": (
        {"crl": "othercrl.pem"},
        "tcp.crl: {0}/othercrl.pem: expected a list of the authority in {0}/ca.pem, found one of "
        "another; give the list that it signed",
    ),
    "a short key": (
        {"certificate": "weak.pem", "key": "weak.key"},
        "tcp.certificate: {}/weak.pem: TLS does not accept the certificate in it: its key is too "
        "short; make one of 2048 bits, or of a curve",
    ),
    "a certificate in PKCS #12": (
        {"certificate": "server.p12"},
        "tcp.certificate: {0}/server.p12: expected a certificate in PEM, found PKCS #12; "
        "take it out with `openssl pkcs12 -in {0}/server.p12 -nokeys -out NEW`",
    ),
    "a key in PKCS #12": (
        {"key": "server.p12"},
        "tcp.key: {0}/server.p12: expected a private key in PEM, found PKCS #12; "
        "take it out with `openssl pkcs12 -in {0}/server.p12 -nocerts -nodes -out NEW`",
    ),
    "a certificate in UTF-16": (
        {"certificate": "utf16.pem"},
        "tcp.certificate: {}/utf16.pem: expected a certificate in PEM, found text in UTF-16; "
        "save it as UTF-8",
    ),
    "a key of OpenSSH": (
        {"key": "openssh.key"},
        "tcp.key: {}/openssh.key: expected a private key in PEM, found a private key of OpenSSH; "
        "give the file of the right kind",
    ),
    "a certificate that is cut off": (
        {"certificate": "cut.pem"},
        "tcp.certificate: {}/cut.pem: a certificate in it is damaged (",
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
    times = ("-startdate", "20200101000000Z", "-enddate", "20200102000000Z")
    made.issue("new", dates=("-startdate", "20900101000000Z", "-enddate", "20910101000000Z"))
    made.run("req", "-new", "-key", "ca.key", "-subj", "/CN=cell", "-out", "oldca.csr")
    signed = ("-batch", "-selfsign", "-extensions", "authority", "-in", "oldca.csr")
    made.run("ca", *signed, *times, "-out", "oldca.pem")
    begin, end = ("-crl_lastupdate", times[1]), ("-crl_nextupdate", times[3])
    made.run("ca", "-gencrl", *begin, *end, "-out", "oldcrl.pem")
    other = Authority(tmp_path_factory.mktemp("other") / "ca", "elsewhere")
    (folder / "othercrl.pem").write_bytes((other.folder / "crl.pem").read_bytes())
    weak = ("-newkey", "rsa:512", "-nodes", "-subj", "/CN=weak")
    openssl("req", "-x509", *weak, "-keyout", "weak.key", "-out", "weak.pem")
    packed = ("-inkey", "server.key", "-passout", "pass:x", "-out", "server.p12")
    openssl("pkcs12", "-export", "-in", "server.pem", *packed)
    certificate = (folder / "server.pem").read_text()
    (folder / "utf16.pem").write_text(certificate, encoding="utf-16")
    (folder / "cut.pem").write_text(f"{certificate[:-300]}\n")
    begin, end = (f"-----{word} OPENSSH PRIVATE KEY-----\n" for word in ("BEGIN", "END"))
    (folder / "openssh.key").write_text(f"{begin}b3BlbnNzaC1rZXktdjEA\n{end}")
    key = (folder / "server.key").read_text()
    (folder / "cut.key").write_text(f"{key[: len(key) // 2]}\n")
    return folder


def files(folder, replaced):
    """Return the files of a daemon, some of them replaced."""
    good = {"certificate": "server.pem", "key": "server.key", "ca": "ca.pem", "crl": "crl.pem"}
    return {name: Path(folder, file) for name, file in {**good, **replaced}.items()}


def is_line(said, line):
    """Return whether a line is as expected; OpenSSL's own words may follow a parenthesis."""
    return said.startswith(line) if line.endswith("(") else said == line


@pytest.mark.parametrize("name", WRONG)
def test_a_daemon_names_a_wrong_file_by_its_setting(folder, name):
    replaced, line = WRONG[name]
    with pytest.raises(ConfigError) as caught:
        server_context(TcpSettings(listen="127.0.0.1:0", **files(folder, replaced)))
    assert is_line(str(caught.value), line.format(folder))


@pytest.mark.parametrize("name", [name for name in WRONG if "crl" not in WRONG[name][0]])
def test_a_client_names_a_wrong_file_before_it_connects(folder, name):
    replaced, line = WRONG[name]
    given = files(folder, replaced)
    with pytest.raises(DaemonError) as caught:
        certificate_files("host:1", given["certificate"], given["key"], given["ca"])
    assert is_line(str(caught.value), line.format(folder).partition(": ")[2])


def test_files_that_are_as_they_should_be_are_taken(folder):
    given = files(folder, {})
    context = server_context(TcpSettings(listen="127.0.0.1:0", **given))
    assert context.verify_mode is ssl.CERT_REQUIRED
    names = [given[name] for name in ("certificate", "key", "ca")]
    assert certificate_files("host:1", *names) == [Path(name) for name in names]
