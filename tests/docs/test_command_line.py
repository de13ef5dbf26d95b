"""The reference of the command line, as the site's generator writes it from the program."""

import sys

from pages import DOCS

sys.path.insert(0, str(DOCS))

from generators import command_line


def test_the_reference_describes_every_argument():
    reference = dict(command_line.pages(DOCS))
    assert "| `FILE` | A motion file" in reference["reference/command-line/move.md"]
    assert "| `[WHAT]` | " in reference["reference/command-line/demo.md"]
