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

REQUESTS = 500
"""Two parts and a half."""


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


def test_a_batch_that_was_killed_leaves_no_worker_and_ends_in_the_same_files(tmp_path):
    file, folder = tmp_path / "many.jsonl", tmp_path / "plans"
    with file.open("w") as lines:
        for number in range(REQUESTS):
            turn = [{"rotation_vector": [0.0, 0.0, angle]} for angle in (0.0, 0.5 + 1e-3 * number)]
            print(json.dumps({"keyframes": turn}), file=lines)
    command = [*COMMAND, "batch", str(file), "--records", "--jobs", "2", "-o", str(folder)]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **silent) as asker:
        until(lambda: list(folder.glob("parts/*.parquet")), "a part")
        workers = [pid for pid in children(asker.pid) if b"LokyProcess" in command_line(pid)]
        asker.kill()
    assert len(workers) == 2
    until(lambda: not any(map(command_line, workers)), "their end", seconds=20.0)
    assert not (folder / "plans.parquet").exists()
    subprocess.run(command, **silent, check=True)
    whole = tmp_path / "whole"
    subprocess.run([*command[:-1], str(whole)], **silent, check=True)
    found = {path.relative_to(folder) for path in folder.rglob("[!.]*")}
    assert found == {path.relative_to(whole) for path in whole.rglob("[!.]*")}
    for path in found:
        if (folder / path).is_file():
            assert (folder / path).read_bytes() == (whole / path).read_bytes()
