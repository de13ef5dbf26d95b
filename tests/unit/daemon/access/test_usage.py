"""The extended key usage of certificates for clients."""

import ssl
import subprocess

import pytest
from authority import OPENSSL, QUICK_KEY

from orientd.daemon.access import tls

pytestmark = pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here")


@pytest.mark.parametrize(
    ("usage", "is_for_clients"),
    [
        ("", False),
        ("extendedKeyUsage=serverAuth", False),
        ("extendedKeyUsage=clientAuth", True),
        ("extendedKeyUsage=critical,serverAuth,clientAuth", True),
        ("keyUsage=digitalSignature", False),
        ("subjectAltName=DNS:clientAuth", False),
    ],
)
def test_a_certificate_for_clients_says_so(tmp_path, usage, is_for_clients):
    path = tmp_path / "one.pem"
    more = ("-addext", usage) if usage else ()
    made = (OPENSSL, "req", "-x509", "-subj", "/CN=x", "-nodes", *QUICK_KEY, *more)
    subprocess.run(
        [*made, "-keyout", tmp_path / "key", "-out", path], check=True, capture_output=True
    )
    assert tls._is_for_clients(ssl.PEM_cert_to_DER_cert(path.read_text())) is is_for_clients
