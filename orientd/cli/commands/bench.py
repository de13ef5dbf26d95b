"""`orientd bench`: punctuality of the servo, speed of curves and of retargets, on this machine."""

from __future__ import annotations

from statistics import median_high
from typing import TYPE_CHECKING, Annotated, Any

import click

from orientd.cli.output import Output, is_terminal, table
from orientd.cli.parameters import Group, Option, command_of, part_of

if TYPE_CHECKING:
    from orientd.bench import Comparison, CurveSpeed


def measure(
    out: Output,
    seconds: Annotated[
        float, Option(range=(0.5, None), help="Duration of one measurement, s.")
    ] = 2.0,
    slots: Annotated[
        int,
        Option(
            range=(1, None),
            help="Number of measurements of the servo and of the C loop, per condition.",
        ),
    ] = 3,
    servo: Annotated[bool, Option(help="Measure the servo's lateness.")] = True,
    curves: Annotated[bool, Option(help="Measure the speed of the curves.")] = True,
) -> None:
    """Measure the servo's lateness and the curves' speed.

    A bare C loop and SciPy (extra `scipy`) run for comparison.  With the defaults this takes
    three minutes.
    """
    if click.get_current_context().invoked_subcommand is not None:
        return
    found = {
        "curves": _curves(out) if curves else None,
        "servo": _servo(seconds, slots, out) if servo else None,
    }
    out.answer(found)


bench = command_of(Group, measure, name="bench", invoke_without_command=True)


@part_of(bench)
def retarget(
    out: Output,
    count: Annotated[
        int, Option(range=(10, None), help="Number of retargets for each number of keyframes.")
    ] = 200,
    keyframes: Annotated[
        list[int] | None,
        Option(
            range=(1, None), help="Number of keyframes per motion; repeatable.  [default: 1, 20]"
        ),
    ] = None,
    rate: Annotated[
        float, Option(range=(1.0, 2000.0), help="Cycle rate of the device in Hz.")
    ] = 500.0,
    priority: Annotated[
        int, Option(range=(0, 99), help="SCHED_FIFO priority of the servo; 0 for none.")
    ] = 0,
) -> None:
    """Measure how long a retarget takes.

    The time is from the call to the first changed setpoint.  The command starts its own daemon with
    a simulated device.  With the defaults this takes a minute.
    """
    from orientd.bench import PARTS, measure_retargets

    found = measure_retargets(
        tuple(keyframes or (1, 20)), count=count, rate_hz=rate, priority=priority
    )
    rows = [
        [
            str(one.keyframes),
            str(one.retargets),
            str(one.replanned),
            *(
                f"{1e3 * one.parts[part].p50:.2f} / {1e3 * one.parts[part].p99:.2f}"
                for part in PARTS
            ),
        ]
        for one in found
    ]
    out.answer(
        {"rate_hz": rate, "priority": priority, "retargets": found},
        f"retargets on the way at {rate:g} Hz, p50 / p99 in ms; each part begins after the other",
        *table(["keyframes", "count", "replanned", *PARTS], rows),
    )


def _curves(out: Output) -> CurveSpeed:
    from orientd.bench import measure_curves

    found = measure_curves(steps=(1.0,))
    out.say(
        f"c2_cumulative of {found.keyframes} keyframes, ns a sample; SciPy is its RotationSpline"
    )
    rows = [
        [
            str(sampling.instants),
            f"{sampling.sorted_ns:.0f} ({sampling.ratio:.0f} x)",
            f"{sampling.unsorted_ns:.0f}",
            f"{sampling.scipy_ns:.0f}",
        ]
        for sampling in found.samplings
    ]
    out.say(*table(["instants", "sorted", "unsorted", "SciPy"], rows), "")
    for building in found.buildings:
        out.say(
            f"built from {building.few} keyframes {building.step:g} rad apart in "
            f"{1e3 * building.few_s:.1f} ms, from {100 * building.few} in "
            f"{building.many_s:.2f} s: {building.growth:.0f} times the time"
        )
    out.say("")
    return found


def _servo(seconds: float, slots: int, out: Output) -> list[dict[str, Any]]:
    from orientd.bench import compare, conditions
    from orientd.errors import OrientdError

    done: list[dict[str, Any]] = []
    rows = []
    for condition in conditions():
        rate_hz, is_loaded, priority, spin_us = condition
        load = "busy" if is_loaded else "idle"
        scheduler = f"FIFO {priority}" if priority else "OTHER"
        asked = {"rate_hz": rate_hz, "load": load, "priority": priority, "spin_us": spin_us}
        row = [f"{rate_hz:g}", load, scheduler, f"{spin_us}"]
        if is_terminal():
            out.say(f"{rate_hz:g} Hz, {load}, {scheduler}, spin {spin_us} us ...")
        try:
            comparison = compare(condition, slots=slots, seconds=seconds)
        except OrientdError as error:
            done.append({**asked, "error": str(error)})
            rows.append([*row, str(error), "", "", "", ""])
            continue
        done.append({**asked, **_figures(comparison)})
        rows.append([*row, *_cells(comparison)])
    header = ["Hz", "load", "scheduler", "spin us", "p50 us", "p99 us", "C p99"]
    out.say(*table([*header, "overruns", "work p99"], rows))
    return done


def _figures(comparison: Comparison) -> dict[str, Any]:
    ours, bare = comparison.overruns
    return {
        "servo": comparison.servo,
        "bare": comparison.bare,
        "p99_ratio": comparison.p99_ratio,
        "overruns": {"servo": ours, "bare": bare},
        "work_p99_us": comparison.work_p99_us,
    }


def _cells(comparison: Comparison) -> list[str]:
    ours, bare = comparison.overruns
    return [
        f"{median_high([slot.p50_us for slot in comparison.servo]):.1f}",
        f"{median_high([slot.p99_us for slot in comparison.servo]):.1f}",
        f"{median_high([slot.p99_us for slot in comparison.bare]):.0f}",
        f"{ours} (C {bare})",
        f"{comparison.work_p99_us:.0f}",
    ]
