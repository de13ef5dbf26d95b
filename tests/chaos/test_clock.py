"""The wall clock steps during motions; run with `make chaos`.

A time namespace has no CLOCK_REALTIME of its own, and a step of the machine's clock would harm
other programs.  So the daemon and its servo load a library that shifts the wall clock.
"""

import mmap
import shutil
import struct
import subprocess
import time
from pathlib import Path

import pytest
from scenes import under_way
from stage import rehearse
from tally import Tally

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]

STEPS = (-86_400.0, -60.0, -1.0, -0.3, 0.3, 1.0, 60.0, 86_400.0)


def test_the_clock_on_the_wall_steps(tmp_path):
    tally = Tally("wall clock steps by 0.3 s to a day, forwards and backwards", 50, "no fault, "
                  "limits, lease and status undisturbed")  # fmt: skip
    compiler = shutil.which("cc")
    if compiler is None:
        tally.skip("clock", "there is no C compiler for the stand-in of the clock")
    shim, offset = tmp_path / "clock.so", tmp_path / "offset"
    source = Path(__file__).with_name("clock_shim.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(shim), str(source)], check=True)
    offset.write_bytes(bytes(4096))

    def harm(stage, number, generator):
        with under_way(stage, number, generator):
            for _ in range(generator.randrange(1, 5)):
                step = generator.choice(STEPS)
                page[:8] = struct.pack("=q", round(step * 1e9))
                time.sleep(generator.uniform(0.0, 0.3))
        stage.come_to_rest()
        stage.settle(faults=("none",))

    environment = {"LD_PRELOAD": str(shim), "CHAOS_CLOCK": str(offset)}
    with offset.open("r+b") as file, mmap.mmap(file.fileno(), 4096) as page:
        page[:8] = struct.pack("=q", round(-86_400e9))
        told = subprocess.run(
            ["date", "+%s"], env=environment, capture_output=True, text=True, check=True
        )
        assert abs(float(told.stdout) + 86_400.0 - time.time()) < 60.0
        rehearse(tmp_path / "daemon", "clock", tally, harm, environment=environment)
