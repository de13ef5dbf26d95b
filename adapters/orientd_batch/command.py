"""Plan a file of many requests."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import click

from orientd.cli.command import ConfigFile, DeviceName, device_settings, need_extra
from orientd.cli.output import Output, updated
from orientd.cli.parameters import Argument, Option, command
from orientd.errors import OrientdError


@command
def batch(
    out: Output,
    file: Annotated[Path, Argument(metavar="REQUESTS", help="A .jsonl file.")],
    output: Annotated[
        Path, Option("--output", "-o", metavar="FOLDER", help="Folder for the plans.")
    ],
    records: Annotated[
        bool, Option("--records", help="Also write every setpoint, to the folder `records`.")
    ] = False,
    backend: Annotated[
        str, Option(help="Where to plan: `loky` on this machine; `ray` or `dask` on a cluster.")
    ] = "loky",
    address: Annotated[
        str | None,
        Option(
            metavar="ADDRESS", help="Address of the cluster; default: a new one on this machine."
        ),
    ] = None,
    jobs: Annotated[
        int, Option("--jobs", "-j", help="Number of parts to plan at a time; -1: one per core.")
    ] = -1,
    config: ConfigFile = None,
    device: DeviceName = "",
) -> None:
    """Plan many motions from a file, without a daemon.

    Each line of the file is a motion file.  FOLDER/plans.parquet then has one row per motion, with
    its certificate or the reason for a refusal.  To continue an interrupted run, give the same
    command again.
    """
    need_extra("batch")
    from orientd.planner.offline import need_backend
    from orientd_batch.batch import plan_file

    if jobs == 0 or jobs < -1:
        raise click.BadParameter(f"expected -1 or at least 1, got {jobs}", param_hint="--jobs")
    need_backend(backend)
    began, begun, done, count = time.monotonic(), -1, 0, 0
    try:
        with updated(out, interval=5.0) as show:
            for done, count in plan_file(
                file, output, device_settings(config, device),
                has_records=records, backend=backend, jobs=jobs, address=address,
            ):  # fmt: skip
                begun = done if begun < 0 else begun
                text = f"{done:,} of {count:,} requests ({done / max(1, count):.0%})"
                if rate := (done - begun) / max(1e-9, time.monotonic() - began):
                    text += f", {rate:,.0f} a second, {(count - done) / rate:,.0f} s left"
                show(text)
    except KeyboardInterrupt:
        raise OrientdError(
            f"interrupted with {done:,} requests done; run the same command to continue"
        ) from None
    table = output / "plans.parquet"
    out.answer({"plans": table, "count": count}, f"wrote {table}")
