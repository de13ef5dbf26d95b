"""An hour at 500 Hz in real time, and a day in virtual time; run with `make chaos`.

``ORIENTD_CHAOS_SECONDS`` and ``ORIENTD_CHAOS_VIRTUAL_SECONDS`` make them shorter or longer.
"""

import os
import time

import numpy as np
import pytest
from harness import ACCELERATION, DEVICE, JERK, VELOCITY, nudge, resident_kib
from rig import PERIOD, TERMS, Rig, peaks, turn
from stage import Stage
from tally import Tally, rounds_of

from orientd.protocol import control_pb2 as pb
from orientd.stream.records import Answer, Command, ServoState

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(30_000)]

SECONDS = float(os.environ.get("ORIENTD_CHAOS_SECONDS", "3600"))
VIRTUAL_SECONDS = float(os.environ.get("ORIENTD_CHAOS_VIRTUAL_SECONDS", "86400"))
GROWTH_KIB = 4096


def test_a_soak_in_real_time(tmp_path):
    tally = Tally("soak at 500 Hz in real time", 70, f"{SECONDS:.0f} s: all motions done, limits, "
                  "bounded memory and open files")  # fmt: skip

    def sizes(stage):
        pid = stage.daemon.process.pid
        files = len(os.listdir(f"/proc/{pid}/fd"))
        return np.array([resident_kib(pid), resident_kib(stage.servo), files])

    def one(number, generator):
        end, before = time.monotonic() + SECONDS, None
        begun, motions = time.monotonic(), 0
        os.truncate(stage.daemon.recording, 0)
        while time.monotonic() < end:
            stage.call("RenewLease", pb.RenewLeaseRequest(token=stage.daemon.token))
            *_, last = stage.begin(nudge(generator.uniform(-0.9, 0.9)))
            assert last.summary.outcome == pb.OUTCOME_DONE, last
            stage.streams.clear()
            motions += 1
            if motions % 20 == 0:
                stage.rests()
                stage.check_sent()
            # The flight recorder's memory is full after a minute and a bit.
            if before is None and time.monotonic() - begun > min(90.0, 0.8 * SECONDS):
                before = sizes(stage)
        cycle = stage.device().cycle
        growth = sizes(stage) - before
        tally.met["motions"] = motions
        tally.met["cycles"] = cycle.index
        tally.met["missed deadlines"] = cycle.missed
        tally.met["growth of the daemon in KiB"] = int(growth[0])
        tally.met["growth of the servo in KiB"] = int(growth[1])
        assert (growth[:2] < GROWTH_KIB).all() or SECONDS < 120.0, growth
        assert growth[2] <= 2, growth
        assert not stage.calls.late, "; ".join(stage.calls.late)
        assert stage.device().state == pb.STATE_HOLDING
        assert DEVICE in stage.status()["devices"]

    with Stage(tmp_path, tally) as stage:
        rounds_of("soak-real", tally, one, rounds=1)


def test_a_soak_in_virtual_time():
    tally = Tally("soak in virtual time: the servo, its rings and the loopback driver", 71,
                  f"{VIRTUAL_SECONDS:.0f} s: all motions done, limits, bounded memory",
                  )  # fmt: skip

    def one(number, generator):
        rig = Rig(heartbeat_ns=10**9)
        assert rig.ask(Command.ENABLE)[0] is Answer.DONE
        angle, before, motions = 1.2, None, 0
        there = turn(angle, duration=2.0)
        back = tuple(np.ascontiguousarray(part[::-1]) for part in there)
        back = (back[0], -back[1], back[2])
        cycles = round(VIRTUAL_SECONDS / PERIOD)
        begun = rig.servo._cycle_count
        while rig.servo._cycle_count - begun < cycles:
            rig.driver.setpoints.clear()
            path = back if motions % 2 else there
            first = rig.lay(*path)
            stops = generator.random() < 0.1
            motion = motions % 1_000_000 + 1
            assert rig.ask(Command.START, motion=motion, path_index=first)[0] is Answer.DONE
            if stops:
                rig.run(generator.randrange(1, 900))
                rig.ask(Command.SPEED, speed=0.0)
                rig.run(400)
                rig.ask(Command.SPEED, speed=1.0)
            rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
            rig.run(generator.randrange(1, 50))
            sent = rig.sent()
            for found, limit in zip(peaks(sent), (VELOCITY, ACCELERATION, JERK), strict=True):
                assert found <= 1.001 * limit, (motions, found, limit)
            assert np.abs(sent[-1] - path[0][-1]).max() < 1e-9
            motions += 1
            if before is None and motions == 50:
                before = resident_kib(os.getpid())
        tally.met["motions"] = motions
        tally.met["cycles"] = rig.servo._cycle_count
        growth = resident_kib(os.getpid()) - before if before else 0
        tally.met["growth in KiB"] = growth
        assert growth < 4 * GROWTH_KIB, growth
        assert TERMS.floats()

    rounds_of("soak-virtual", tally, one, rounds=1)
