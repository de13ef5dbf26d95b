"""Obstacles to real time on this machine: every check measures.

Scheduling, locked memory and lateness are measured in a separate process, which starts like a servo
process.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from orientd import processor
from orientd.driver import Finding, Verdict
from orientd.errors import KernelsError

PRIORITY = 80
PERIOD_NS = 2_000_000
CYCLES = 500

GOOD_LATENESS = 250e-6
BAD_LATENESS = 1e-3
"""Limits of the p99 lateness at 500 Hz, s: an eighth and a half of the period."""

SHARED_MEMORY_NEEDED = 64 * 1024 * 1024
"""Bytes for the rings of some ten devices at 1000 Hz."""

_PROBE = """
import json, sys
from orientd.servo.realtime import DeadlineTimer, freeze_garbage, lock_memory, set_scheduling
import time
scheduling = set_scheduling(int(sys.argv[1]))
is_locked = lock_memory()
freeze_garbage()
period, count = int(sys.argv[2]), int(sys.argv[3])
timer = DeadlineTimer()
deadline = time.monotonic_ns() + period
lateness = []
for _ in range(count):
    lateness.append(timer.wait(deadline) - deadline)
    deadline = max(deadline + period, time.monotonic_ns())
lateness.sort()
print(json.dumps({
    "scheduling": scheduling,
    "memory_locked": is_locked,
    "p50": lateness[count // 2] * 1e-9,
    "p99": lateness[count * 99 // 100] * 1e-9,
    "largest": lateness[-1] * 1e-9,
}))
"""


def findings() -> list[Finding]:
    """Return every finding; takes two seconds."""
    looks = (
        *(_servo, _kernel, _throttling, _cores, _isolation, _governor, _latency_request),
        *(_clock_source, _swap, _shared_memory, _runtime_directory, _python, _kernels),
    )
    return [finding for look in looks for finding in look()]


def _judged(
    name: str, found: str, mend: str = "", *, is_well: bool, is_bad: bool = False
) -> Finding:
    """Return a finding that is good, a problem if *is_bad*, or otherwise an improvement."""
    if is_well:
        return Finding(name, found, Verdict.OK)
    return Finding(name, found, Verdict.PROBLEM if is_bad else Verdict.IMPROVE, mend)


def _servo() -> Iterator[Finding]:
    arguments = [sys.executable, "-c", _PROBE, str(PRIORITY), str(PERIOD_NS), str(CYCLES)]
    done = subprocess.run(
        arguments, capture_output=True, text=True, timeout=60, cwd="/", check=False
    )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        yield Finding("servo process", f"does not run: {last}", Verdict.PROBLEM, "reinstall")
        return
    probe = json.loads(done.stdout)
    yield _scheduling(probe["scheduling"])
    yield _memory(probe["memory_locked"])
    yield _lateness(probe["p50"], probe["p99"], probe["largest"])


def _scheduling(got: str) -> Finding:
    soft, hard = resource.getrlimit(resource.RLIMIT_RTPRIO)
    is_granted = got.startswith("SCHED_FIFO")
    refused = f"SCHED_FIFO {PRIORITY} refused (RLIMIT_RTPRIO is {soft}, at most {hard}); got {got}"
    return _judged(
        "scheduling",
        f"{got} granted" if is_granted else refused,
        f"`LimitRTPRIO={PRIORITY}` in the systemd unit (`orientd service install` writes it), or "
        f"`@GROUP - rtprio {PRIORITY}` in /etc/security/limits.conf and a new login",
        is_well=is_granted,
    )


def _memory(is_locked: bool) -> Finding:
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    limit = "unlimited" if soft == resource.RLIM_INFINITY else f"{soft // 1024} KiB"
    return _judged(
        "memory lock",
        f"{'granted' if is_locked else 'refused'} (RLIMIT_MEMLOCK is {limit})",
        "`LimitMEMLOCK=infinity` in the systemd unit (`orientd service install` writes it), or "
        "`@GROUP - memlock unlimited` in /etc/security/limits.conf and a new login",
        is_well=is_locked,
    )


def _lateness(p50: float, p99: float, largest: float) -> Finding:
    return _judged(
        "lateness",
        f"p50 {1e3 * p50:.3f} ms, p99 {1e3 * p99:.3f} ms, largest {1e3 * largest:.3f} ms in "
        f"{CYCLES} cycles at 500 Hz",
        f"see the other rows; the load is {os.getloadavg()[0]:.1f} at the moment",
        is_well=p99 <= GOOD_LATENESS,
        is_bad=p99 > BAD_LATENESS,
    )


def _kernel() -> Iterator[Finding]:
    version = platform.version()
    mode = _read("/sys/kernel/debug/sched/preempt")
    chosen = f" ({mode})" if mode else ""
    is_preemptive = "PREEMPT" in version
    yield _judged(
        "kernel",
        f"{platform.system()} {platform.release()} {version}{chosen}",
        "a kernel with PREEMPT_RT; without one, boot with preempt=full"
        if is_preemptive
        else "a kernel with PREEMPT_RT or PREEMPT_DYNAMIC",
        is_well=_read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in version,
        is_bad=not is_preemptive,
    )


def _throttling() -> Iterator[Finding]:
    runtime = _read("/proc/sys/kernel/sched_rt_runtime_us")
    period = _read("/proc/sys/kernel/sched_rt_period_us")
    if runtime == "-1" and period:
        yield Finding("throttling", "none", Verdict.OK)
    elif runtime and period:
        share = 100.0 * int(runtime) / int(period)
        found = f"real-time processes get {share:.0f} % of {int(period) / 1e6:g} s"
        mend = "sysctl kernel.sched_rt_runtime_us=950000"
        yield _judged("throttling", found, mend, is_well=share >= 50.0)


def _cores() -> Iterator[Finding]:
    usable = len(os.sched_getaffinity(0))
    mend = "two at the least: one servo, one for the rest"
    yield _judged("cores", f"{usable} usable of {os.cpu_count()}", mend, is_well=usable >= 2)


def _isolation() -> Iterator[Finding]:
    isolated = _read("/sys/devices/system/cpu/isolated")
    is_small = (os.cpu_count() or 1) < 4
    yield _judged(
        "isolated cores",
        isolated or ("none, with too few cores to spare one" if is_small else "none"),
        "boot with isolcpus= and nohz_full= for a core, and pin the servo to it",
        is_well=bool(isolated) or is_small,
    )


def _governor() -> Iterator[Finding]:
    paths = sorted(Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    governors = sorted({_read(path) for path in paths} - {""})
    found = f"governor {', '.join(governors)}" if governors else "not scaled by this kernel"
    mend = "cpupower frequency-set -g performance"
    yield _judged("frequency", found, mend, is_well=governors in ([], ["performance"]))


def _latency_request() -> Iterator[Finding]:
    path = "/dev/cpu_dma_latency"
    found, is_well = f"{path} can be held open", True
    if not Path("/sys/devices/system/cpu/cpu0/cpuidle").is_dir():
        found = "not entered by this kernel"
    else:
        try:
            os.close(os.open(path, os.O_WRONLY))
        except OSError as error:
            found, is_well = f"{path} cannot be opened: {error.strerror}", False
    mend = (
        "a udev rule that gives your group write access to it: a core that need not wake from a "
        "deep state is less late"
    )
    yield _judged("idle states", found, mend, is_well=is_well)


def _clock_source() -> Iterator[Finding]:
    source = _read("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source:
        is_quick = source not in ("hpet", "acpi_pm", "jiffies", "refined-jiffies")
        yield _judged("clock", source, "boot with clocksource=tsc tsc=reliable", is_well=is_quick)


def _swap() -> Iterator[Finding]:
    areas = _read("/proc/swaps").splitlines()[1:]
    used = sum(int(area.split()[3]) for area in areas)
    found = f"{len(areas)} areas, {used // 1024} MiB used" if areas else "none"
    yield _judged("swap", found, "more memory, or sysctl vm.swappiness=1", is_well=used == 0)


def _shared_memory() -> Iterator[Finding]:
    name = "shared memory"
    try:
        usage = os.statvfs("/dev/shm")
    except OSError as error:
        mend = "mount a tmpfs on /dev/shm"
        yield Finding(name, f"/dev/shm: {error.strerror}", Verdict.PROBLEM, mend)
        return
    # A servo's memory is in no file system, so the files in this one do not reduce it.  Its size is
    # the limit of the machine, or the container.
    size = usage.f_blocks * usage.f_frsize
    found = f"the machine sets {size // 2**20} MiB aside, as the size of /dev/shm says"
    mend = f"at least {SHARED_MEMORY_NEEDED // 2**20} MiB: mount -o remount,size=256M /dev/shm"
    yield _judged(name, found, mend, is_well=size >= SHARED_MEMORY_NEEDED, is_bad=True)


def _runtime_directory() -> Iterator[Finding]:
    directory = os.environ.get("XDG_RUNTIME_DIR")
    found, mend = directory or "", "unset it, or have it point to a directory of yours"
    is_well = bool(directory) and os.access(directory or "", os.W_OK | os.X_OK)
    if not directory:
        found = f"XDG_RUNTIME_DIR is not set; the socket goes to /tmp/orientd-{os.getuid()}"
        mend = "a login by systemd-logind, or `RuntimeDirectory=` in the systemd unit"
    elif not is_well:
        found = f"XDG_RUNTIME_DIR={directory} cannot be written to"
    yield _judged("runtime directory", found, mend, is_well=is_well, is_bad=bool(directory))


def _python() -> Iterator[Finding]:
    version = f"{platform.python_implementation()} {platform.python_version()}"
    yield Finding("python", version, Verdict.OK)


def _kernels() -> Iterator[Finding]:
    name = "compiled kernels"
    try:
        from orientd import kernels
    except KernelsError as error:
        yield Finding(name, str(error), Verdict.PROBLEM, "nothing can be planned until then")
    except ImportError as error:
        yield Finding(name, f"do not load: {error}", Verdict.PROBLEM, "install orientd again")
    else:
        forced = os.environ.get(processor.FORCED)
        mend = f"unset {processor.FORCED}, unless {forced} is meant"
        found = f"{kernels.LEVEL}, {'as forced' if forced else 'loaded'}"
        yield _judged(name, found, mend, is_well=not forced)


def _read(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8").strip()
    except OSError:
        return ""
