"""The example that plays the chunks of a simulated policy, with a daemon."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "policy_chunks" / "play.py"
SWING = 47.0
"""Angle between the two orientations of the policy, degrees."""


def test_the_chunks_of_a_policy_keep_the_limits_and_turn_the_short_way(daemon, tmp_path):
    pytest.importorskip("matplotlib")
    done = subprocess.run(
        [sys.executable, EXAMPLE],
        cwd=tmp_path,
        env={**os.environ, "ORIENTD_SOCKET": str(daemon.socket)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found = {
        name.strip(): [float(one) for one in figures.split()]
        for name, figures in re.findall(r"^([a-z ]+?)  +([\d.e+ ]+)$", done.stdout, re.MULTILINE)
    }
    (limit,) = found["limit"]
    turned, _, acceleration, above = found["orientd"]
    assert acceleration <= 1.001 * limit
    assert above == 0
    assert found["straight lines"][2] > 1000.0 * limit
    assert found["piecewise slerp"][2] > 10.0 * limit
    # Four times to and fro; the twins of the vectors cost a turn every time.
    assert turned < 5 * SWING
    assert found["piecewise slerp"][0] < 5 * SWING
    assert found["straight lines"][0] > 2.0 * 360.0
    assert "27 chunks" in done.stdout
    assert (tmp_path / "policy-chunks.png").read_bytes().startswith(b"\x89PNG")
