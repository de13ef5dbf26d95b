"""Damaged files: each is read or refused in one line, with little memory.

Run with `make storm`; fewer of them: ORIENTD_STORM_FILES=1000.
"""

import os
import random
from collections import Counter

import pytest
from mutations import check, damaged_file, seeds

pytestmark = pytest.mark.filterwarnings("ignore:.*more than a whole turn")

FILES = int(os.environ.get("ORIENTD_STORM_FILES", "50000"))
SEED = int(os.environ.get("ORIENTD_STORM_SEED", "1"))


def rehearse(folder, count, seed):
    whole = seeds(folder)
    assert all(check(path) for path in whole)
    found = Counter()
    (folder / "damaged").mkdir()
    for number in range(count):
        chance = random.Random(f"{seed} {number}")
        source = whole[number % len(whole)]
        path = folder / "damaged" / source.name
        damaged_file(source, path, chance)
        try:
            found[source.name, check(path)] += 1
        except BaseException:
            print(f"{path}: number {number} of seed {seed}")
            raise
    return found


def test_some_damaged_files_are_refused_in_one_line(tmp_path):
    found = rehearse(tmp_path, 200, SEED)
    assert {is_read for _, is_read in found} == {False, True}


@pytest.mark.storm
@pytest.mark.timeout(0)
def test_damaged_files_are_refused_in_one_line(tmp_path):
    found = rehearse(tmp_path, FILES, SEED)
    print(f"{FILES} damaged files, seed {SEED}: {dict(sorted(found.items()))}")
