"""The doctor's conclusions from its findings about the machine."""

import os
import sys
from types import SimpleNamespace

import pytest

from orientd import processor
from orientd.cli import machine
from orientd.driver import Verdict


@pytest.fixture
def files(monkeypatch):
    """Stand in for the kernel's files."""
    content = {}
    monkeypatch.setattr(machine, "_read", lambda path: content.get(str(path), ""))
    return content


def verdict(findings):
    (finding,) = findings
    assert bool(finding.mend) == (finding.verdict is not Verdict.OK)
    return finding.verdict


@pytest.mark.parametrize(
    ("realtime", "version", "expected"),
    [
        ("1", "#1 SMP PREEMPT_RT", Verdict.OK),
        ("", "#1 SMP PREEMPT_RT", Verdict.OK),
        ("", "#1 SMP PREEMPT_DYNAMIC", Verdict.IMPROVE),
        ("", "#1 SMP", Verdict.PROBLEM),
    ],
)
def test_the_kernel_is_judged_by_its_preemption(files, monkeypatch, realtime, version, expected):
    files["/sys/kernel/realtime"] = realtime
    monkeypatch.setattr(machine.platform, "version", lambda: version)
    assert verdict(machine._kernel()) is expected


@pytest.mark.parametrize(
    ("p99", "expected"),
    [(100e-6, Verdict.OK), (600e-6, Verdict.IMPROVE), (2e-3, Verdict.PROBLEM)],
)
def test_lateness_is_judged_against_the_period(p99, expected):
    assert verdict([machine._lateness(50e-6, p99, 3e-3)]) is expected


def test_scheduling_that_was_granted_is_well():
    assert verdict([machine._scheduling("SCHED_FIFO 80")]) is Verdict.OK
    refused = machine._scheduling("SCHED_OTHER, slice 0.1 ms")
    assert refused.verdict is Verdict.IMPROVE
    assert "SCHED_OTHER, slice 0.1 ms" in refused.found
    assert "LimitRTPRIO" in refused.mend


def test_memory_that_may_not_be_locked_can_be_mended():
    assert verdict([machine._memory(True)]) is Verdict.OK
    assert "LimitMEMLOCK" in machine._memory(False).mend


@pytest.mark.parametrize(
    ("runtime", "expected"),
    [("-1", Verdict.OK), ("950000", Verdict.OK), ("100000", Verdict.IMPROVE)],
)
def test_throttling_is_judged_by_the_share_left(files, runtime, expected):
    files["/proc/sys/kernel/sched_rt_runtime_us"] = runtime
    files["/proc/sys/kernel/sched_rt_period_us"] = "1000000"
    assert verdict(machine._throttling()) is expected


@pytest.mark.parametrize(("source", "expected"), [("tsc", Verdict.OK), ("hpet", Verdict.IMPROVE)])
def test_a_slow_clock_is_told(files, source, expected):
    files["/sys/devices/system/clocksource/clocksource0/current_clocksource"] = source
    assert verdict(machine._clock_source()) is expected


@pytest.mark.parametrize(
    ("swaps", "expected"),
    [
        ("", Verdict.OK),
        ("Filename Type Size Used Priority\n/swap file 1000 0 -2", Verdict.OK),
        ("Filename Type Size Used Priority\n/swap file 1000 900 -2", Verdict.IMPROVE),
    ],
)
def test_swap_that_is_used_is_told(files, swaps, expected):
    files["/proc/swaps"] = swaps
    assert verdict(machine._swap()) is expected


def test_a_runtime_directory_is_wanted(monkeypatch, tmp_path):
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    assert verdict(machine._runtime_directory()) is Verdict.IMPROVE
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert verdict(machine._runtime_directory()) is Verdict.OK
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "absent"))
    assert verdict(machine._runtime_directory()) is Verdict.PROBLEM


def test_one_core_is_too_few(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0})
    assert verdict(machine._cores()) is Verdict.IMPROVE


def test_the_kernels_are_loaded_and_their_level_named(monkeypatch):
    monkeypatch.delenv(processor.FORCED, raising=False)
    (finding,) = machine._kernels()
    assert finding.verdict is Verdict.OK
    assert processor.level() in finding.found


def test_kernels_of_a_forced_level_are_named_as_such(monkeypatch):
    monkeypatch.setenv(processor.FORCED, processor.level())
    assert verdict(machine._kernels()) is Verdict.IMPROVE


def test_kernels_that_do_not_load_are_a_problem(monkeypatch):
    monkeypatch.delattr("orientd.kernels")
    monkeypatch.delitem(sys.modules, "orientd.kernels")
    monkeypatch.setenv(processor.FORCED, "x86-64-v5")
    (finding,) = machine._kernels()
    assert finding.verdict is Verdict.PROBLEM
    assert "got 'x86-64-v5'" in finding.found


def test_a_servo_that_does_not_run_is_a_problem(monkeypatch):
    monkeypatch.setattr(machine, "_PROBE", "raise SystemExit('no such thing')")
    (finding,) = machine._servo()
    assert finding.verdict is Verdict.PROBLEM
    assert "no such thing" in finding.found


@pytest.mark.parametrize(
    ("mebibytes", "expected"), [(63, machine.Verdict.PROBLEM), (65, machine.Verdict.OK)]
)
def test_what_lies_in_shared_memory_takes_nothing_from_a_servo(monkeypatch, mebibytes, expected):
    full = SimpleNamespace(f_bavail=0, f_blocks=256 * mebibytes, f_frsize=4096)
    monkeypatch.setattr(machine.os, "statvfs", lambda _: full)
    assert verdict(machine._shared_memory()) is expected
