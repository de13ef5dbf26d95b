"""How long a chunk of 50 poses takes from the client's call to the first setpoint that it moves."""

import threading
import time

import numpy as np
import pytest
from harness import DaemonProcess
from scipy.spatial.transform import Rotation

import orientd
from orientd.protocol import control_pb2 as pb

pytestmark = [pytest.mark.bench, pytest.mark.timeout(120)]

CHUNKS, PAUSE = 40, 0.7
ALLOWED_P50_MS, ALLOWED_P99_MS = 5.0, 15.0


def test_a_chunk_moves_the_device_within_milliseconds(tmp_path):
    sent_ns, cycles, ended = [], [], threading.Event()
    rise = 0.02 * np.minimum(np.arange(50) / 10.0, 1.0)
    with DaemonProcess(tmp_path) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket) as robot, orientd.connect(daemon.socket) as other:

            def watch():
                for batch in other.watch():
                    cycles.extend(batch)
                    if ended.is_set():
                        return

            watching = threading.Thread(target=watch)
            watching.start()
            with robot.play() as play:
                for k in range(CHUNKS):
                    angles = rise if k % 2 == 0 else 0.02 - rise
                    poses = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0]))
                    sent_ns.append(time.monotonic_ns())
                    play.chunk(poses, rate=100.0)
                    time.sleep(PAUSE)
            ended.set()
            watching.join()
    # A cycle works on the setpoint that moves some microseconds after its deadline.
    moving = [
        cycle.deadline_ns + cycle.lateness_ns
        for cycle in cycles
        if np.linalg.norm(cycle.omega_body) > 1e-7
    ]
    late = [min(at for at in moving if at > one) - one for one in sent_ns]
    p50, p99 = np.percentile(late, [50, 99]) / 1e6
    print(f"\na chunk of 50 poses moves the device after {p50:.1f} ms, 99 % within {p99:.1f} ms")
    assert p50 <= ALLOWED_P50_MS
    assert p99 <= ALLOWED_P99_MS
