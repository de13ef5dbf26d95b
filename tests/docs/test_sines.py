"""The page of chunks is measured when it is built, and its figures hold."""

import sys

import pytest
from pages import DOCS

pytest.importorskip("matplotlib")

sys.path.insert(0, str(DOCS))
from generators import sines


def test_sines_in_chunks_are_met_without_lag_or_excess_where_others_have_steps():
    for hertz in (0.5, 2.0):
        ours, slerp, components = sines.measured(hertz)
        assert ours.error < 2e-3
        assert abs(ours.lag) < 1e-3
        assert ours.peak < 1.05
        assert slerp.peak > 20.0
        assert components.peak > 1e4


def test_the_page_has_a_row_for_each_sine(tmp_path):
    ((name, text),) = sines.pages(tmp_path)
    assert name == "explanation/chunks.md"
    assert sum(" Hz, " in line and line.startswith("|") for line in text.splitlines()) == 5
