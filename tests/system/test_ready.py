"""A daemon is ready once it can plan."""

from harness import DaemonProcess

import orientd

_SLOW_PLANNERS = """
import pathlib, sys, time
if "orientd.daemon.planners" in sys.orig_argv:
    time.sleep(6.0)
    pathlib.Path(__file__).with_name("loading").touch()
"""


def test_a_daemon_whose_planners_start_slowly_is_ready_when_they_are(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(_SLOW_PLANNERS)
    daemon = DaemonProcess(tmp_path)
    daemon.import_from(tmp_path)
    with daemon, orientd.connect(daemon.socket, holder="test") as robot:
        assert (tmp_path / "loading").exists()
        assert robot.plan([{"rotation_vector": [0, 0, 0.1]}]).duration > 0.0
