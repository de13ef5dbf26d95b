"""The ledger of promises counts those whose tests have run."""

import os
import subprocess
import sys

import promises

LEDGER = {
    "README.md": {
        "": {"It moves.": "unit/test_a.py::test_moves", "It stops.": ["a.py::one", "b.py::two"]},
        "explains": ["Where next"],
    },
    "faults": {"STALLED": "chaos/test_b.py::test_stalls"},
    "untested": {"options": ["quiet"]},
}


def test_what_no_test_holds_is_told_with_the_tests_that_it_needs():
    now = frozenset({"unit/test_a.py::test_moves"})
    first, *others = promises.held(
        LEDGER, now, {"chaos/test_b.py::test_stalls": "2026-02-03"}
    ).splitlines()
    assert first == (
        "promises: 1 held by tests that passed now, "
        "1 by tests that passed at night, since 2026-02-03 or later, 1 by none"
    )
    assert others == ['README.md: : "It stops." needs a.py::one or b.py::two']


def test_what_has_passed_is_noted_and_nothing_else(tmp_path):
    passed, file = tmp_path / "passed", tmp_path / "test_one.py"
    passed.mkdir()
    file.write_text(
        "import pytest\n"
        "@pytest.mark.parametrize('k', [1, 2])\n"
        "def test_passes(k): pass\n"
        "def test_fails(): assert False\n"
        "def test_is_skipped(): pytest.skip('for once')\n"
    )
    own = {name: value for name, value in os.environ.items() if "XDIST" not in name}
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "conftest", "-p", "no:cacheprovider", file],
        env={**own, "TESTS_THAT_PASSED": str(passed), "PYTHONPATH": str(promises.TESTS)},
        cwd=tmp_path, capture_output=True, check=False,
    )  # fmt: skip
    assert promises.passed(passed) == {"../test_one.py::test_passes"}
