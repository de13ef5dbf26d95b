"""Kernels come back from tables that no caller of ours makes."""

import os
import subprocess
import sys
from pathlib import Path

FUZZ = Path(__file__).with_name("fuzz.py")
CASES = os.environ.get("ORIENTD_CASES", "60")


def test_every_kernel_answers_spoilt_tables(tmp_path):
    log = tmp_path / "call"
    found = subprocess.run(
        [sys.executable, str(FUZZ), CASES, "5"],
        env={**os.environ, "ORIENTD_FUZZ_LOG": str(log)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 0, f"at the call {log.read_text().strip()}: {found.stderr}"
    assert "no call was recorded" not in found.stdout, found.stdout
    assert "all came back" in found.stdout
