"""Plan a file of many requests."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.command import ConfigFile, DeviceName, device_settings
from orientd.cli.output import Output, is_terminal
from orientd.cli.parameters import Argument, Option, command
from orientd.errors import OrientdError

if TYPE_CHECKING:
    from orientd_batch import Batch

_INTERVAL = 5.0
"""Interval between two plain lines, s."""


@command
def batch(
    out: Output,
    file: Annotated[Path, Argument(metavar="REQUESTS", help="A .jsonl, .csv or .parquet file.")],
    output: Annotated[
        Path, Option("--output", "-o", metavar="FOLDER", help="Folder for the plans.")
    ],
    records: Annotated[
        bool, Option("--records", help="Also write every setpoint, to the folder `records`.")
    ] = False,
    backend: Annotated[
        str,
        Option(
            "--backend", help="Where to plan: `loky` on this machine; `ray` or `dask` on a cluster."
        ),
    ] = "loky",
    address: Annotated[
        str | None,
        Option(
            "--address",
            metavar="ADDRESS",
            help="Address of the cluster; default: a new one on this machine.",
        ),
    ] = None,
    jobs: Annotated[
        int, Option("--jobs", "-j", help="Number of parts to plan at a time; -1: one per core.")
    ] = -1,
    config: ConfigFile = None,
    device: DeviceName = "",
) -> None:
    """Plan many motions from a file, without a daemon.

    Each line of a .jsonl file is a motion file.  In a table, each row is a keyframe, and rows with
    the same `motion` form one motion.  FOLDER/plans.parquet then has one row per motion, with its
    certificate or the reason for a refusal.  To continue an interrupted run, give the same command
    again.
    """
    from orientd_batch import Batch, open_requests

    if jobs == 0 or jobs < -1:
        raise click.BadParameter(f"expected -1 or at least 1, got {jobs}", param_hint="--jobs")
    run = Batch(
        open_requests(file), output, device_settings(config, device),
        has_records=records, backend=backend, jobs=jobs, address=address,
    )  # fmt: skip
    began, shown = time.monotonic(), 0.0
    try:
        for _ in run.run():
            now = time.monotonic()
            if not out.as_json and (is_terminal() or now >= shown + _INTERVAL):
                shown = now
                _show(run, now - began, out)
    except KeyboardInterrupt:
        raise OrientdError(
            f"interrupted with {run.done:,} requests done; run the same command to continue"
        ) from None
    if is_terminal():
        out.say("")
    out.answer({"plans": run.table, "count": run.count}, f"wrote {run.table}")


def _show(run: Batch, seconds: float, out: Output) -> None:
    text = f"{run.done:,} of {run.count:,} requests ({run.done / max(1, run.count):.0%})"
    rate = (run.done - run.begun_with) / max(1e-9, seconds)
    if rate > 0.0:
        text += f", {rate:,.0f} a second, {(run.count - run.done) / rate:,.0f} s left"
    if is_terminal():
        print(f"\r{text}\x1b[K", end="", flush=True)  # noqa: T201
    else:
        out.say(text)
