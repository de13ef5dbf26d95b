"""Batches as processes: what is left of one that was killed."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import COMMAND
from harness import children, until

pytest.importorskip("joblib")
pytest.importorskip("pyarrow")

REQUESTS = 3000


def command_line(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except FileNotFoundError:
        return b""


def test_a_worker_whose_asker_is_gone_before_it_has_begun_ends():
    """As one does whose asker is killed while it still loads what it needs."""
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    begin = f"import time, orientd.planner.offline as offline; offline._settle(None, {gone.pid})"
    worker = [sys.executable, "-c", f"{begin}; time.sleep(30)"]
    assert subprocess.run(worker, timeout=20.0).returncode == 1


def test_no_worker_outlives_whoever_asked_and_was_killed(tmp_path):
    file, folder = tmp_path / "many.jsonl", tmp_path / "plans"
    turn = [{"rotation_vector": [0.0, 0.0, angle]} for angle in (0.0, 0.5)]
    file.write_text(REQUESTS * (json.dumps({"keyframes": turn}) + "\n"))
    command = [*COMMAND, "batch", str(file), "-o", str(folder), "--jobs", "2"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **silent) as asker:
        until(lambda: list(folder.glob("parts/*.parquet")), "a part")
        workers = [pid for pid in children(asker.pid) if b"LokyProcess" in command_line(pid)]
        asker.kill()
    assert len(workers) == 2
    until(lambda: not any(map(command_line, workers)), "their end", seconds=20.0)
