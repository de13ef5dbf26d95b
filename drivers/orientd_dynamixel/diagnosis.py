"""A deployment's bus, looked at: port, adapter, every servo, the rate that it can hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from orientd.driver import Finding, Verdict
from orientd.errors import DeviceError, LinkError
from orientd_dynamixel.bus import READ_WAIT_S, OpenBus
from orientd_dynamixel.doctor import (
    SCAN_WAIT_MS,
    FoundServo,
    advise,
    cycle_ms,
    find_ports,
    latency_timer_ms,
    measure_cycle_ms,
    safe_rate_hz,
    scan,
)
from orientd_dynamixel.options import BAUD_RATES, GimbalOptions
from orientd_dynamixel.settings import foreign

_IDS = 21
"""Numbers asked besides those configured: 0 to 20."""
_GOOD_TIMER_MS = 1.0
"""The adapter's timer where the machine does not tell it: what it should be set to."""


def diagnose(options: GimbalOptions, period: float, open_bus: OpenBus) -> list[Finding]:
    """Return what there is to say of the bus that *options* name; changes nothing.

    Args:
        options: of the deployment.
        period: of its cycle, s.
        open_bus: opens the port.
    """
    port = Path(options.port)
    found = [_ports(port)]
    if found[0].verdict is Verdict.PROBLEM:
        return found
    timer = latency_timer_ms(port)
    found.append(_timer(timer))
    wanted = [axis.id for axis in options.axes]
    wait = max(SCAN_WAIT_MS, options.latency_ms, timer or 0.0)
    try:
        # First at the speed that the daemon would use: a port in use is not touched further.
        servos = scan(
            options.port, bauds=[options.baud], ids=sorted({*range(_IDS), *wanted}),
            wanted=wanted, wait_ms=wait, open_bus=open_bus,
        )  # fmt: skip
        missing = [number for number in wanted if number not in {one.id for one in servos}]
        if missing:
            others = [baud for baud in BAUD_RATES if baud != options.baud]
            servos += scan(options.port, bauds=others, ids=missing, wait_ms=wait, open_bus=open_bus)
        found += [_servo(servo, options) for servo in servos]
        found += [_absent(number) for number in missing if number not in {s.id for s in servos}]
        found += [Finding("bus", "can do better", Verdict.IMPROVE, one) for one in advise(servos)]
        ours = [one for one in servos if one.id in wanted and one.baud == options.baud]
        if len(ours) == len(wanted):
            found.append(_rate(ours, options, period, timer, open_bus))
    except LinkError as error:
        found.append(
            Finding("bus", str(error), Verdict.PROBLEM, "is a daemon using it? end it first")
        )
    except DeviceError as error:
        found.append(Finding("bus", str(error), Verdict.PROBLEM, "look at cable and supply"))
    return found


def _ports(port: Path) -> Finding:
    there = ", ".join(map(str, find_ports())) or "none"
    if port.exists():
        return Finding("port", f"{port} is there; adapters: {there}", Verdict.OK)
    return Finding(
        "port",
        f"{port} is not there; adapters: {there}",
        Verdict.PROBLEM,
        "plug the adapter in, or name one of these as port",
    )


def _timer(timer_ms: int | None) -> Finding:
    if timer_ms is None:
        return Finding("latency timer", "not told for this port", Verdict.OK)
    if timer_ms <= 1:
        return Finding("latency timer", f"{timer_ms} ms", Verdict.OK)
    mend = (
        "write 1 to its latency_timer under /sys/bus/usb-serial/devices, with a udev rule to "
        "keep it, and set latency_ms"
    )
    return Finding("latency timer", f"{timer_ms} ms", Verdict.IMPROVE, mend)


def _servo(servo: FoundServo, options: GimbalOptions) -> Finding:
    axis = next((axis for axis in options.axes if axis.id == servo.id), None)
    text = (
        f"{servo.name}, firmware {servo.firmware}, {servo.baud} baud, return delay "
        f"{servo.return_delay_us} us"
    )
    if axis is None:
        return Finding(f"servo {servo.id}", f"{text}; not configured", Verdict.OK)
    name = f"servo {servo.id} ({axis.name})"
    if servo.baud != options.baud:
        mend = f"configured are {options.baud} baud: set the servo or `baud`"
        return Finding(name, text, Verdict.PROBLEM, mend)
    if servo.model != axis.model.number:
        mend = f"configured is {axis.model.name}"
        return Finding(name, text, Verdict.PROBLEM, mend)
    own = foreign(axis, servo.settings)
    if refused := own.keys() - options.overwrite:
        said = ", ".join(f"{setting} {own[setting][0]}" for setting in sorted(refused))
        mend = f"put it right with the vendor's wizard, or set overwrite = {sorted(refused)}"
        return Finding(name, f"{text}; its own {said}", Verdict.PROBLEM, mend)
    return Finding(name, text, Verdict.OK)


def _absent(number: int) -> Finding:
    return Finding(
        f"servo {number}",
        "does not answer at any line speed",
        Verdict.PROBLEM,
        "look at its cable, its supply and its id",
    )


def _rate(
    servos: list[FoundServo],
    options: GimbalOptions,
    period: float,
    timer: int | None,
    open_bus: OpenBus,
) -> Finding:
    latency = _GOOD_TIMER_MS if timer is None else timer
    # The driver sets the return delay to 0 when it starts.
    tuned = [replace(one, return_delay_us=0) for one in servos]
    safe = safe_rate_hz(tuned, options.baud, latency_ms=latency)
    bus = open_bus(options.port, options.baud, wait_ms=options.latency_ms, glance_s=READ_WAIT_S)
    try:
        measured = measure_cycle_ms(bus, servos)
    finally:
        bus.close()
    text = (
        f"{safe:.0f} Hz with room to spare (a cycle of "
        f"{cycle_ms(tuned, options.baud, latency_ms=latency):.2f} ms, calculated); a read of all "
        f"takes {measured:.2f} ms now, measured; configured are {1 / period:.0f} Hz"
    )
    if 1 / period <= safe:
        return Finding("rate", text, Verdict.OK)
    return Finding(
        "rate",
        text,
        Verdict.IMPROVE,
        f"set rate_hz to {safe:.0f} or less, or the servos to a higher line speed",
    )
