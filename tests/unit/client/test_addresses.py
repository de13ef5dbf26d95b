"""Addresses that installed packages resolve."""

import os
import subprocess
import sys

import pytest
from harness import install

RESOLVE = """
def resolve(name, certificate, key, ca):
    assert (certificate, key, ca) == (None, None, None)
    return f"unix:/run/{name}.sock"
"""
ENTRIES = "[orientd.addresses]\nlab = foreign:resolve\nbroken = foreign.missing:resolve\n"
FIND = """
import sys
from orientd.client.channel import Way
from orientd.errors import DaemonError
try:
    print(Way.find(address=sys.argv[1]))
except DaemonError as error:
    print(error)
"""


@pytest.fixture
def found(tmp_path):
    """Return where an address leads beside a package that resolves addresses."""
    install(tmp_path, "foreign", ENTRIES, RESOLVE)

    def find(address):
        return subprocess.run(
            [sys.executable, "-c", FIND, address],
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()

    return find


def test_a_package_resolves_the_addresses_of_its_scheme(found):
    assert found("lab:arm-1") == "/run/arm-1.sock"
    assert found("unix:/run/own.sock") == "/run/own.sock"
    assert found("lab:7450").startswith("lab:7450 needs a certificate")  # a host and its port


def test_a_package_that_cannot_be_loaded_is_named(found):
    assert found("broken:arm-1").startswith("broken:arm-1: cannot load foreign.missing:resolve: ")
