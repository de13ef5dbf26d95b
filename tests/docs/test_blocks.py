"""Every code block of tutorials and guides is well formed; those without a daemon are run."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml
from follower import Follower
from pages import DOCS, REASONS, blocks, pages

from orientd import config, motion_file
from orientd.cli.main import app
from orientd_fleet.settings import MemberSettings

QUICK = ["frames.md", "keep-out.md", "library.md", "satellite-pass.md"]
TURN = [{"rotation_vector": [0, 0, 0]}, {"rotation_vector": [0, 0, 1]}]


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.stem)
def test_what_a_page_shows_is_well_formed(page):
    for block in blocks(page):
        assert block.language in {"sh", "python", "yaml", "toml", "text"}, block.place
        assert not block.why_not or block.why_not in REASONS, block.place
        if block.language == "yaml":
            motion_file.parse({"keyframes": TURN, **yaml.safe_load(block.text)})
        elif block.language == "toml" and "[project]" not in block.text:
            check_settings(tomllib.loads(block.text))
        elif block.language == "python":
            compile(block.text, block.place, "exec")
        elif block.language == "sh":
            for line in commands(block.text):
                check_command(line)


def check_settings(table):
    """Check a configuration, or the part of one that a page shows."""
    devices = table.setdefault("devices", {"arm": {"driver": "loopback"}})
    for device in devices.values():
        device.setdefault("driver", "loopback")
    kind = MemberSettings if "fleet" in table else config.Settings
    config.parse_as(kind, table, source="a page")


def commands(text):
    """Yield the words of each call of orientd in a shell's lines."""
    for line in re.split(r"[\n|&;]+", text.replace("\\\n", " ")):
        words = shlex.split(line, comments=True)
        if words and words[0] == "sudo":
            del words[0]
        if words and words[0] == "orientd":
            yield words[1:]


def check_command(words):
    """Check that a command has these options, without doing what it says."""
    group = app
    context = group.make_context("orientd", list(words), resilient_parsing=True)
    rest = [*context._protected_args, *context.args]
    while rest:
        command = group.get_command(context, rest[0])
        assert command is not None, words
        context = command.make_context(rest[0], rest[1:], parent=context, resilient_parsing=True)
        group = command
        rest = [*context._protected_args, *context.args] if hasattr(command, "commands") else []


@pytest.mark.parametrize("name", QUICK)
def test_a_page_without_a_daemon_does_what_it_shows(tmp_path, name):
    with Follower(tmp_path) as follower:
        for block in blocks(DOCS / "how-to" / name):
            follower.do(block)


def test_the_readme_is_short_and_says_what_it_must():
    text = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    for needed in ("> **Safety.**", ".readme/demo.png", "make demo", "make test", "The first five"):
        assert needed in text


def test_nothing_tells_anybody_to_install_somebody_elses_package():
    root = DOCS.parent
    files = [root / "README.md", root / "Makefile", *DOCS.rglob("*.md")]
    for folder in ("orientd", "adapters", "drivers", "sim", "tests", "examples"):
        files += (root / folder).rglob("*.py")
    for file in files:
        if file != Path(__file__):
            text = file.read_text(encoding="utf-8")
            assert not re.search(r"pip install [^\n]*orientd(?!-motion)\b", text), file


def test_pages_install_from_the_clone():
    """No release is on an index: in a new environment a name would not be found."""
    for page in (DOCS.parent / "README.md", *pages()):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"^(sudo )?\S*pip install .*orientd-motion", text, re.MULTILINE), page


def test_every_item_of_a_numbered_list_begins_a_line():
    for page in DOCS.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"^\d\. .*(\n   .*)*\. \d\. ", text, re.MULTILINE), page
