"""The page of errors and faults is complete, and follows the code."""

import shutil
import sys
from enum import IntEnum

import pytest
from pages import DOCS

from orientd.errors import Fault

sys.path.insert(0, str(DOCS))
from generators import messages


def made(source=DOCS):
    ((_, text),) = messages.pages(source)
    return text


def test_every_fault_and_every_message_has_its_place():
    text = made()
    assert all(f"### {str(fault).lower()}\n" in text for fault in Fault if fault)
    assert "- `` no daemon answers at ...; start one with `orientd run` ``" in text


def test_a_fault_without_cause_and_cure_stops_the_build(monkeypatch):
    more = IntEnum("Fault", [*(one.name for one in Fault), "BROKEN_WRIST"], start=0)
    monkeypatch.setattr(messages, "Fault", more)
    with pytest.raises(ValueError, match="broken_wrist"):
        made()


def test_a_guide_that_quotes_a_message_that_is_gone_stops_the_build(tmp_path):
    sources = tmp_path / messages.SOURCES[0]
    sources.mkdir()
    shutil.copy(DOCS.parent / "orientd" / "errors.py", sources)
    shutil.copytree(DOCS / "reference" / "parts", tmp_path / "docs" / "reference" / "parts")
    guide = tmp_path / "docs" / messages.GUIDE
    guide.parent.mkdir()
    guide.write_text("| `the flux capacitor of ... is empty` | Refill it. |\n", encoding="utf-8")
    with pytest.raises(ValueError, match="flux capacitor"):
        made(tmp_path / "docs")
