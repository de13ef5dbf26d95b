"""Write the tables of the page "How it compares", every cell from a run.

``make peers`` makes an environment with the peers and runs this file in it.  If a package is
missing there, its cells say so.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import peer_curves
import peer_durations
import peer_timing

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "comparison.md"
BEGIN, END = "<!-- peers:begin -->", "<!-- peers:end -->"
PACKAGES = ("numpy", "scipy", "splines", "drake", "ruckig", "toppra")


def table(what, rows, peers):
    """Return a Markdown table of measurements: rows are properties, columns are packages."""
    lines = [
        f"| {what} | " + " | ".join(f"{peer.name}<br>{peer.what}" for peer in peers) + " |",
        "|" + "---|" * (len(peers) + 1),
    ]
    for name, measure in rows:
        cells = [cell(measure, peer) for peer in peers]
        print(name, cells, flush=True)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


def cell(measure, peer):
    """Return the measurement, or a note that the package is missing."""
    try:
        return measure(peer)
    except ImportError as error:
        return f"not run: no {error.name}"


def versions():
    """Return the versions of the packages."""
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} not installed")
    return ", ".join(found)


def main():
    lines = [
        *table("Curves through keyframes", peer_curves.ROWS, peer_curves.PEERS),
        "",
        *table("Motion within limits", peer_timing.ROWS, peer_timing.PEERS),
        "",
        *table("Mean duration", peer_durations.ROWS, peer_durations.PEERS),
        "",
        f"Measured with {versions()}.",
    ]
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    PAGE.write_text(before + BEGIN + "\n" + "\n".join(lines) + "\n" + END + after)


if __name__ == "__main__":
    main()
