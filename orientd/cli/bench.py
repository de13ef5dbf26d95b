"""`orientd bench`: the servo's lateness and the curves' speed on this machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from orientd.cli.output import AsJson, command, is_terminal, say, say_json, table

if TYPE_CHECKING:
    from orientd.bench.servo import Comparison


@command
def bench(
    seconds: Annotated[float, typer.Option(min=0.5, help="Length of one slot, s.")] = 2.0,
    slots: Annotated[
        int, typer.Option(min=1, help="Pairs of slots, servo and bare C loop, per condition.")
    ] = 3,
    as_json: AsJson = False,
) -> None:
    """Measure the servo's lateness, beside a bare C loop, and the curves' speed.

    With the defaults this takes a minute and a half.
    """
    servo = _servo(seconds, slots, as_json=as_json)
    if as_json:
        say_json({"servo": servo})


def _servo(seconds: float, slots: int, *, as_json: bool) -> list[dict[str, Any]]:
    from orientd.bench.servo import compare, conditions
    from orientd.errors import OrientdError

    done: list[dict[str, Any]] = []
    rows = []
    for rate_hz, is_loaded, priority in conditions():
        load = "busy" if is_loaded else "idle"
        scheduler = f"FIFO {priority}" if priority else "OTHER"
        if not as_json and is_terminal():
            say(f"{rate_hz:g} Hz, {load}, {scheduler} ...")
        try:
            comparison = compare(
                rate_hz=rate_hz,
                is_loaded=is_loaded,
                priority=priority,
                slots=slots,
                seconds=seconds,
            )
        except OrientdError as error:
            done.append({"rate_hz": rate_hz, "load": load, "error": str(error)})
            rows.append([f"{rate_hz:g}", load, scheduler, str(error), "", "", "", ""])
            continue
        done.append(_figures(comparison, load))
        rows.append([f"{rate_hz:g}", load, scheduler, *_cells(comparison)])
    if not as_json:
        header = ["Hz", "load", "scheduler", "p50 us", "p99 us", "C p99", "overruns", "work p99"]
        say(*table(header, rows))
    return done


def _median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def _figures(comparison: Comparison, load: str) -> dict[str, Any]:
    ours, bare = comparison.overruns
    return {
        "rate_hz": comparison.rate_hz,
        "load": load,
        "priority": comparison.priority,
        "servo": comparison.servo,
        "bare": comparison.bare,
        "p99_ratio": comparison.p99_ratio,
        "overruns": {"servo": ours, "bare": bare},
        "work_p99_us": comparison.work_p99_us,
    }


def _cells(comparison: Comparison) -> list[str]:
    ours, bare = comparison.overruns
    return [
        f"{_median([slot.p50_us for slot in comparison.servo]):.0f}",
        f"{_median([slot.p99_us for slot in comparison.servo]):.0f}",
        f"{_median([slot.p99_us for slot in comparison.bare]):.0f}",
        f"{ours} (C {bare})",
        f"{comparison.work_p99_us:.0f}",
    ]
