"""The gimbal's stream, compared with plain use of the vendor's SDK in the same run.

Both send goals to three emulated servos and read their position, velocity and current each cycle,
over a pseudo-terminal paced like 1 Mbps with a 1 ms adapter, the emulator in its own process.  Set
``ORIENTD_BENCH_SECONDS`` for other than 60 s a stream.
"""

import json
import math
import os
import subprocess
import sys

import pytest

pytest.importorskip("dynamixel_sdk")
pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]

SECONDS = float(os.environ.get("ORIENTD_BENCH_SECONDS", "60"))

OURS = """
import json, math, sys, time
from orientd.clock import MonotonicClock
from orientd.driver import Setpoint
from orientd_dynamixel import DynamixelDriver
link, rate, seconds = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
period = round(1e9 / rate)
driver = DynamixelDriver({"port": link, "axes": [{"id": k} for k in (1, 2, 3)], "max_losses": 50,
                          "overwrite": ["operating_mode"]},
                         period_ns=period, clock=MonotonicClock())
driver.open()
driver.enable()
work, late, fresh, last = [], [], 0, 0
cpu, begin = time.process_time(), time.monotonic_ns()
due = begin
count = round(rate * seconds)
for k in range(count):
    due += period
    time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
    start = time.monotonic_ns()
    feedback = driver.read()
    fresh += feedback.time_ns != last
    last = feedback.time_ns
    half = 0.2 * (1 - math.cos(k / rate))
    driver.write(Setpoint(due, (math.cos(half), 0.0, 0.0, math.sin(half))))
    end = time.monotonic_ns()
    work.append(end - start)
    late.append(start - due)
cpu, span = time.process_time() - cpu, time.monotonic_ns() - begin
losses = driver._group.lost
driver.close()
"""
PLAIN = """
import json, math, sys, time
from dynamixel_sdk import *
link, rate, seconds = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
period = round(1e9 / rate)
port, ph = PortHandler(link), PacketHandler(2.0)
port.openPort()
port.setBaudRate(1000000)
for k in (1, 2, 3):
    ph.write1ByteTxRx(port, k, 64, 0)
    ph.write1ByteTxRx(port, k, 9, 0)
    ph.write1ByteTxRx(port, k, 11, 4)
    ph.write1ByteTxRx(port, k, 64, 1)
write, read = GroupSyncWrite(port, ph, 116, 4), GroupSyncRead(port, ph, 126, 10)
for k in (1, 2, 3):
    read.addParam(k)
    write.addParam(k, [0, 8, 0, 0])
work, late, fresh, losses = [], [], 0, 0
cpu, begin = time.process_time(), time.monotonic_ns()
due = begin
count = round(rate * seconds)
for k in range(count):
    due += period
    time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
    start = time.monotonic_ns()
    goal = 2048 + round(0.4 * (1 - math.cos(k / rate)) * 652)
    for servo in (1, 2, 3):
        write.changeParam(servo, [DXL_LOBYTE(goal), DXL_HIBYTE(goal), 0, 0])
    write.txPacket()
    if read.txRxPacket() == 0:
        fresh += 1
        [read.getData(servo, 132, 4) for servo in (1, 2, 3)]
    else:
        losses += 1
    end = time.monotonic_ns()
    work.append(end - start)
    late.append(start - due)
cpu, span = time.process_time() - cpu, time.monotonic_ns() - begin
port.closePort()
"""
REPORT = """
work.sort(); late.sort()
at = lambda values, share: values[min(len(values) - 1, int(share * len(values)))] * 1e-6
print(json.dumps({"rate_hz": count / span * 1e9, "fresh": fresh / count, "losses": losses,
                  "cpu": cpu / span * 1e9,
                  "work_p50_ms": at(work, .5), "work_p99_ms": at(work, .99),
                  "late_p99_ms": at(late, .99)}))
"""


def measure(program, link, rate):
    done = subprocess.run(
        [sys.executable, "-c", program + REPORT, str(link), str(rate), str(SECONDS)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture
def link(tmp_path):
    place = tmp_path / "bus"
    process = subprocess.Popen(
        [sys.executable, "-m", "orientd", "sim", "dynamixel", "--link", str(place)],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    process.stdout.readline()
    yield place
    process.terminate()
    process.wait(10)
    process.stdout.close()


@pytest.mark.parametrize("rate", [100, 200])
def test_stream_costs_a_third_of_the_plain_loop(link, rate):
    ours, plain = measure(OURS, link, rate), measure(PLAIN, link, rate)
    for name, row in (("orientd", ours), ("plain SDK", plain)):
        print(
            f"{rate} Hz {name:9}: {row['rate_hz']:.2f} Hz, CPU {100 * row['cpu']:.1f} %, "
            f"cycle p50 {row['work_p50_ms']:.3f} p99 {row['work_p99_ms']:.3f} ms, "
            f"late p99 {row['late_p99_ms']:.2f} ms, "
            f"fresh {100 * row['fresh']:.2f} %, lost {row['losses']}"
        )
    assert math.isclose(ours["rate_hz"], rate, rel_tol=0.01)
    if rate == 200:
        assert ours["cpu"] <= plain["cpu"] / 3
