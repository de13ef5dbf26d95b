"""A planned motion in a file: csv, npz or json, by the suffix of its name."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import numpy as np

from orientd.cli.output import plain
from orientd.files import written
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import Samples
from orientd.rotation import Floats

ENDINGS = (".csv", ".npz", ".json")

COLUMNS = (
    "time_s",
    *(f"q{axis}" for axis in "wxyz"),
    *(f"omega_body_{axis}_rad_s" for axis in "xyz"),
    *(f"alpha_body_{axis}_rad_s2" for axis in "xyz"),
    *(f"position_{axis}_m" for axis in "xyz"),
    *(f"velocity_{axis}_m_s" for axis in "xyz"),
)


def write(path: Path, samples: Samples, certificate: pb.Certificate) -> None:
    """Write *samples* to *path*; npz and json hold the certificate too.

    Raises:
        OrientdError: the file cannot be written.
    """
    with written(path) as file:
        if path.suffix == ".csv":
            table = _table(samples)
            np.savetxt(
                file, table, fmt="%.17g", delimiter=",", header=",".join(COLUMNS), comments=""
            )
        elif path.suffix == ".npz":
            np.savez(
                file,
                time=samples.times,
                q_wxyz=samples.q,
                omega_body=samples.omega_body,
                alpha_body=samples.alpha_body,
                position=samples.position,
                velocity=samples.velocity,
                certificate=np.array(json.dumps(plain(certificate))),
            )
        else:
            content = {
                "certificate": plain(certificate),
                "columns": COLUMNS,
                "rows": _table(samples).tolist(),
            }
            file.write_text(json.dumps(content), encoding="utf-8")


def _table(samples: Samples) -> Floats:
    return np.column_stack([getattr(samples, field.name) for field in fields(samples)])
