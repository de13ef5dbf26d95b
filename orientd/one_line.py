"""Text for one line: text from others that is harmless in a terminal, and numbers of things."""

from __future__ import annotations

MOST = 1000
"""Most characters of such a line."""


def shown(text: str) -> str:
    r"""Return *text* with escapes for what a terminal would obey; lines and tabs stay.

    >>> shown("a\x1b[2J\n\tb \xfc")
    'a\\x1b[2J\n\tb \xfc'
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in "\n\t" else ascii(one)[1:-1] for one in text)


def counted(number: int, noun: str) -> str:
    """Return a number of things.

    >>> counted(1, "keyframe"), counted(3, "keyframe")
    ('1 keyframe', '3 keyframes')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def one_line(text: str, most: int = MOST) -> str:
    r"""Return *text* on one line of at most *most* characters, with escapes where it is not shown.

    >>> one_line("a\x1b[2J\nb \u202egnp.exe")
    'a\\x1b[2J b \\u202egnp.exe'
    """
    line = shown(" ".join(text[: 4 * most].split()))
    return line if len(line) <= most else f"{line[: most - 3]}..."
