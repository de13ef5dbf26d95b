"""Each case of interpolation is planned or refused as its page says."""

import shutil
import sys

import pytest
from pages import DOCS

pytest.importorskip("matplotlib")

sys.path.insert(0, str(DOCS))
from generators import cases


def made(folder, change=lambda text: text):
    file = folder / cases.FOLDER / "cases.toml"
    file.parent.mkdir(parents=True)
    shutil.copy(DOCS / cases.FOLDER / "cases.toml", file)
    file.write_text(change(file.read_text(encoding="utf-8")), encoding="utf-8")
    ((_, text),) = cases.pages(folder)
    return text


def test_every_case_has_a_picture_or_the_line_that_refuses_it(tmp_path):
    text = made(tmp_path)
    pictures = list((tmp_path / cases.FOLDER / "pictures").iterdir())
    assert len(pictures) == text.count("![") > 5
    assert len(pictures) + text.count("```text") == text.count("\n## ")
    assert "unknown key; did you mean 'method'?" in text


def test_a_case_that_is_not_refused_any_more_stops_the_build(tmp_path):
    def mended(text):
        begin, *cases = text.partition("[[cases]]")
        (wrong,) = [case for case in "".join(cases).split("[[cases]]") if "metod: squad" in case]
        return begin + "[[cases]]" + wrong.replace("metod: squad", "method: squad")

    with pytest.raises(ValueError, match="'Wrong: an unknown key' is not refused"):
        made(tmp_path, mended)
