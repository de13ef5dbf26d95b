"""The standard test set says what the families do."""

import effort
import pytest
import regenerate
import sequences

from orientd.curves import METHODS

NAMES = regenerate.names()
SEARCHES = {"nielson_shieh": 1e-2, "spherical_quadratic": 1e-2}
"""Families that end a search: relative tolerance of their figures."""

FEW = ("boomerang", "clustered", "fly_through", "rest_to_rest")
"""Sequences on which the families that take long are tried each time."""

FIGURES = regenerate.COLUMNS[2:-1]
SLOW = ("nielson_heiland", "min_acceleration", "kks_interpolating")
QUICK = tuple(name for name in METHODS if name not in SLOW)
CASES = [
    *((sequence, QUICK) for sequence in NAMES),
    *(
        pytest.param(sequence, SLOW, marks=() if sequence in FEW else pytest.mark.slow)
        for sequence in NAMES
    ),
]


@pytest.mark.parametrize("sequence", sequences.SEQUENCES, ids=lambda one: one.__name__)
def test_motion_files_are_what_their_recipe_makes(sequence):
    path = regenerate.HERE / f"{sequence.__name__}.yaml"
    assert path.read_text(encoding="utf-8") == sequences.text_of(sequence)


@pytest.mark.parametrize("sequence", NAMES)
def test_every_family_is_in_every_table(sequence):
    assert {result["family"] for result in regenerate.published(sequence)} == set(METHODS)


@pytest.mark.parametrize(
    ("sequence", "families"), CASES, ids=lambda one: one if isinstance(one, str) else f"{len(one)}"
)
def test_published_results_are_what_the_families_do(sequence, families):
    published = {result["family"]: result for result in regenerate.published(sequence)}
    made = {result["family"]: result for result in regenerate.rows(sequence, families)}
    for family, result in made.items():
        expected = published[family]
        assert ("why_not" in result) == ("why_not" in expected), family
        if "why_not" in result:
            continue
        assert result["interpolates"] == expected["interpolates"], family
        for column in FIGURES:
            ours, theirs = result.get(column) or "0", expected.get(column) or "0"
            tolerance = SEARCHES.get(family, 1e-5)
            # Six digits are published; what is zero has the rounding of the fit.
            assert float(ours) == pytest.approx(float(theirs), rel=tolerance, abs=1e-7), (
                family,
                column,
            )


def test_the_overview_is_of_the_published_results():
    text = (regenerate.HERE / "README.md").read_text(encoding="utf-8")
    assert text == regenerate.readme()


@pytest.mark.slow
def test_the_published_efforts_are_what_the_families_take():
    columns = {step: effort.column(step, range(effort.SEEDS)) for step in effort.STEPS_DEG}
    published = (regenerate.HERE / "EFFORT.md").read_text(encoding="utf-8")
    assert published == effort.table(columns, effort.SEEDS)
