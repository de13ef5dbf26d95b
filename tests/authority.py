"""A certificate authority made with OpenSSL, by the commands that config/ca.cnf gives."""

import os
import shutil
import subprocess
from pathlib import Path

CONFIGURATION = Path(__file__).parents[1] / "config" / "ca.cnf"
OPENSSL = shutil.which("openssl")
QUICK_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256")


class Authority:
    """Signs and revokes certificates in a folder."""

    def __init__(self, folder, name="cell"):
        self.folder = folder
        folder.mkdir(mode=0o700, parents=True)
        shutil.copy(CONFIGURATION, folder)
        (folder / "index.txt").touch()
        made = ("-extensions", "authority", "-days", "3650", "-subj", f"/CN={name}")
        self.run("req", "-x509", *made, *QUICK_KEY, "-keyout", "ca.key", "-out", "ca.pem")
        self.run("ca", "-gencrl", "-out", "crl.pem")

    def run(self, *arguments):
        return subprocess.run(
            [OPENSSL, *arguments],
            cwd=self.folder,
            env={**os.environ, "OPENSSL_CONF": CONFIGURATION.name},
            check=True,
            capture_output=True,
            text=True,
        ).stdout

    def issue(self, name, *, hosts="", dates=(), use="", subject="", alternative=""):
        """Sign a certificate; *hosts*, for a daemon, as OpenSSL writes alternative names."""
        other = hosts or alternative
        names = ("-addext", f"subjectAltName={other}") if other else ()
        files = ("-keyout", f"{name}.key", "-out", f"{name}.csr")
        self.run("req", "-new", "-subj", subject or f"/CN={name}", *names, *QUICK_KEY, *files)
        use = use or ("server" if hosts else "client")
        self.run(
            "ca", "-batch", "-extensions", use, *dates, "-in", f"{name}.csr", "-out", f"{name}.pem"
        )

    def expired(self, name):
        """Sign a certificate that does not count any more."""
        self.issue(name, dates=("-startdate", "20200101000000Z", "-enddate", "20200102000000Z"))

    def revoke(self, name):
        self.run("ca", "-revoke", f"{name}.pem")
        self.run("ca", "-gencrl", "-out", "crl.pem")

    def serial(self, name):
        return self.run("x509", "-noout", "-serial", "-in", f"{name}.pem").strip().split("=")[1]
