"""Recordings: record, and convert to a table."""

from __future__ import annotations

import _thread
import contextlib
import errno
import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.command import DeviceName, Endpoint, Partial, check_ending, devices, need_extra
from orientd.cli.output import Output
from orientd.cli.parameters import Argument, Option
from orientd.errors import OrientdError
from orientd.one_line import counted

if TYPE_CHECKING:
    from orientd.recorder.session import LiveRecording

OutFile = Annotated[Path, Argument(metavar="OUT.mcap", help="The file to write.")]
Seconds = Annotated[
    float | None,
    Option("--seconds", "-s", metavar="SECONDS", help="Duration; default: until Ctrl-C."),
]
Scalars = Annotated[
    bool, Option("--scalars", hidden=True, help="Does nothing: each cycle is plain numbers.")
]


def record(
    at: Endpoint,
    out: Output,
    file: OutFile,
    device: Annotated[
        list[str] | None,
        Option(
            "--device",
            "-d",
            metavar="DEVICE",
            help="Devices; default: all.",
            shell_complete=devices,
        ),
    ] = None,
    seconds: Seconds = None,
    scalars: Scalars = False,
) -> None:
    """Record every cycle, event and plan to an MCAP file.

    Ctrl-C or SIGTERM ends it.  Foxglove and Lichtblick can open the file.  Each cycle has planned,
    sent and measured values.
    """
    check_output(file, seconds)
    tell_scalars(out, is_given=scalars)
    from orientd.recorder.session import RecordingSession

    with at.connect("record") as robot:
        session = RecordingSession(robot, file, device or ())
        out.say(f"recording to {file}")
        with ending(session, seconds):
            session.run()
    tell(session, file, out)


def tell_scalars(out: Output, *, is_given: bool) -> None:
    """Report that the option ``--scalars`` of earlier versions has no effect any more."""
    if is_given:
        out.say("note: --scalars does nothing any more: /DEVICE/cycles holds plain numbers")


def check_output(file: Path, seconds: float | None) -> None:
    """Check that a recording of this duration can be written to *file*.

    Raises:
        click.BadParameter: the name, or the time, is not valid.
        OrientdError: it exists already, or a package for it is not installed.
    """
    if seconds is not None and not 0.0 < seconds < threading.TIMEOUT_MAX:
        raise click.BadParameter(f"expected more than 0, got {seconds:g}", param_hint="--seconds")
    check_ending(file, [".mcap"], named="OUT.mcap")
    if file.is_file():
        raise OrientdError(f"cannot write {file}: it is there already")
    if not file.absolute().parent.is_dir():
        raise OrientdError(f"cannot write {file}: {os.strerror(errno.ENOENT)}")
    need_extra("record")


@contextlib.contextmanager
def ending(session: LiveRecording, seconds: float | None) -> Iterator[None]:
    """End a recording after a number of seconds, or at Ctrl-C or SIGTERM."""

    def end(*_: object) -> None:
        # In a thread of its own: the interrupted code may hold the lock that this takes.
        _thread.start_new_thread(session.end, ())

    before = {
        number: signal.signal(number, end)
        for number in (signal.SIGINT, signal.SIGTERM)
        if threading.current_thread() is threading.main_thread()
    }
    session.seconds = seconds
    timer = threading.Timer(seconds or 0.0, session.end)
    timer.daemon = True
    if seconds is not None:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def tell(session: LiveRecording, file: Path, out: Output) -> None:
    """Print what was recorded to *file*."""
    size = file.stat().st_size
    figures = {"cycles": session.cycles, "lost": session.lost, "events": session.events}
    lines = [
        f"{name}: {counted(cycles, 'cycle')}"
        f"{f', {session.lost[name]} lost' if session.lost[name] else ''}"
        for name, cycles in session.cycles.items()
    ]
    lines.append(f"wrote {file}: {counted(session.events, 'event')}, {size / 1e6:.2f} MB")
    out.answer({"recording": file, "bytes": size, **figures}, *lines)


ENDINGS = (".csv", ".npz", ".parquet")


def export(
    out: Output,
    file: Annotated[
        Path,
        Argument(metavar="RECORDING", help="A recording of orientd."),
    ],
    output: Annotated[
        Path, Option("--output", "-o", help="A .csv, .npz or .parquet file to write.")
    ],
    device: DeviceName = "",
    partial: Partial = False,
) -> None:
    """Write the cycles of a recording as a table.

    Each row is a cycle, with planned, sent and measured values.  Parquet needs the extra `parquet`.
    """
    check_ending(output, ENDINGS, named="--output")
    need_extra("record")
    from orientd.recorder.reader import load_recording
    from orientd.recorder.tables import export as write

    recording = load_recording(file, partial=partial)
    rows = write(recording, recording.device(device), output)
    cut = [] if recording.is_complete else [f"{file} is not whole: {recording.damages.describe()}"]
    out.answer(
        {"output": output, "rows": rows, "is_complete": recording.is_complete},
        *cut,
        f"wrote {output}: {counted(rows, 'cycle')}",
    )
