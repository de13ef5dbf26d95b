"""The ledger of promises counts those whose tests have run."""

import os
import subprocess
import sys
import tomllib

import night
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


def test_a_promise_is_held_if_one_of_its_tests_has_passed():
    now = frozenset({"unit/test_a.py::test_moves", "b.py::two", "chaos/test_b.py::test_stalls"})
    assert promises.held(LEDGER, now, {}) == (
        "promises: 3 held by tests that passed now, 0 by tests that passed at night, 0 by none"
    )


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


def test_a_night_notes_the_date_of_the_tests_of_promises_alone(tmp_path, monkeypatch):
    file = tmp_path / "at_night.toml"
    file.write_text('# A comment.\n"b.py::two" = "2026-01-01"\n"gone.py::three" = "2026-01-01"\n')
    ledger = tmp_path / "promises.toml"
    ledger.write_text('["README.md".""]\n"It stops." = ["a.py::one", "b.py::two"]\n')
    monkeypatch.setattr(promises, "AT_NIGHT", file)
    monkeypatch.setattr(promises, "FILE", ledger)
    folder = tmp_path / "passed"
    folder.mkdir()
    (folder / "1").write_text("a.py::one\nunit/test_c.py::test_of_no_promise\n")
    night.note_promises(folder)
    assert file.read_text().startswith("# A comment.\n")
    dates = tomllib.loads(file.read_text())
    assert list(dates) == ["a.py::one", "b.py::two"]
    assert dates["b.py::two"] == "2026-01-01"
