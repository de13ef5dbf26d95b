"""A reader who follows the pages word by word gets the output that they show."""

import subprocess
import sys
from pathlib import Path

import pytest
from follower import Follower
from pages import DOCS, blocks, pages

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.follow


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.stem)
def test_a_page_does_what_it_shows(tmp_path, page):
    with Follower(tmp_path) as follower:
        for block in blocks(page):
            follower.do(block)


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """A folder with the wheel, as it would be published."""
    folder = tmp_path_factory.mktemp("wheels")
    command = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", folder, ROOT]
    subprocess.run(command, check=True, capture_output=True)
    return folder


def test_the_first_three_tutorials_in_a_fresh_environment(tmp_path, wheels):
    for name in ("first-motion.md", "first-arm.md", "first-gimbal.md"):
        with Follower(tmp_path, fresh=wheels) as follower:
            for block in blocks(DOCS / "tutorials" / name):
                follower.do(block)
