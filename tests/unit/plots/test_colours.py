"""Colours stay apart for everybody and in print.

The simulation of colour-blindness is that of Machado, Oliveira and Fernandes (2009), at full
severity; differences are distances in CIELAB.
"""

from itertools import combinations

import numpy as np
import pytest

from orientd.plots.paper import AXES, INK, LIMIT, PAPER, SERIES

MACHADO = {
    "nobody": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = np.array([0.95047, 1.0, 1.08883])


def seen(colour, matrix):
    """CIELAB coordinates of a colour as somebody sees it."""
    encoded = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    relative = TO_XYZ @ np.clip(np.asarray(matrix) @ linear, 0.0, 1.0) / WHITE
    f = np.where(relative > 216 / 24389, np.cbrt(relative), (24389 / 27 * relative + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("who", MACHADO)
def test_the_axes_differ_for_whoever_looks(who):
    for one, other in combinations(AXES, 2):
        difference = seen(one.colour, MACHADO[who]) - seen(other.colour, MACHADO[who])
        assert np.linalg.norm(difference) > 30.0, (one.name, other.name)


def test_the_axes_differ_in_grey_print():
    for one, other in combinations(AXES, 2):
        lightness = seen(one.colour, np.eye(3))[0] - seen(other.colour, np.eye(3))[0]
        assert abs(lightness) > 15.0, (one.name, other.name)


@pytest.mark.parametrize("who", MACHADO)
def test_hidden_halves_are_paler_than_what_is_in_front(who):
    paper = seen(PAPER, MACHADO[who])
    for axis in AXES:
        front, hidden = (
            np.linalg.norm(paper - seen(colour, MACHADO[who]))
            for colour in (axis.colour, axis.subdued)
        )
        assert hidden < 0.75 * front, axis.name
        assert hidden > 12.0, axis.name


def test_text_and_limits_can_be_read_on_paper():
    for colour in (INK, LIMIT):
        assert seen(PAPER, np.eye(3))[0] - seen(colour, np.eye(3))[0] > 50.0


def test_no_two_lines_of_a_chart_have_the_same_stroke_or_mark():
    for styles in (AXES, SERIES):
        assert len({str(style.stroke) for style in styles}) == len(styles)
        assert len({style.mark for style in styles}) == len(styles)
