"""What the daemon's own process has loaded once motions have run."""

from pathlib import Path

from harness import DaemonProcess, nudge

from orientd.rpc import control_pb2 as pb

HEAVY = ("/scipy/", "/scipy.libs/", "native.abi3")
"""What is for processes that plan alone: libraries by their paths."""


def test_the_daemon_loads_nothing_that_only_planning_needs(tmp_path):
    with DaemonProcess(tmp_path) as daemon:
        for method in ("", "minimum_effort", "squad"):
            motion = nudge(0.2)
            motion.method = method
            *_, last = daemon.move(motion)
            assert last.summary.outcome == pb.OUTCOME_DONE, last
        maps = Path(f"/proc/{daemon.process.pid}/maps").read_text().splitlines()
    libraries = {line.split()[-1] for line in maps if ".so" in line}
    assert not {path for path in libraries if any(part in path for part in HEAVY)}
