"""Hints for misspelt names and numbers in messages."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches

_WITH_UNIT = re.compile(r"[-+]?\d[\d.]*\s*(deg|rad|m|mm|cm|ms|us|s|min|h|Hz|°|%)(/s|/s\^?[23])?")
_LONGEST_QUANTITY = 40
"""Characters of a number with its unit."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a hint at the nearest of the *known* names, or an empty string.

    Initials of a name are its nearest match: ``ttl`` is ``time_to_live``.
    """
    known = list(known)
    near = [one for one in known if name == "".join(word[:1] for word in one.split("_"))]
    near = near or [one for one in known if name.casefold() == one.casefold()]
    near = near or get_close_matches(name[:100], known, n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def unknown_key(key: str, known: Iterable[str]) -> str:
    """Return the message for a *key* of a table that is not among the *known* ones."""
    known = list(known)
    hint = did_you_mean(key, known)
    if key.isdigit():  # what a decimal comma leaves: {time: 3,5}
        hint = "; write numbers with a decimal point"
    return f"unknown key{hint}; known are {', '.join(known)}"


def number_hint(came: str) -> str:
    """Return how a text would be a number, in parentheses; empty if it is far from one."""
    if is_number(came):
        return " (without quotes it would be a number)"
    if is_number(came.replace(",", ".", 1)):
        return " (with a decimal point it would be a number)"
    if len(came) <= _LONGEST_QUANTITY and _WITH_UNIT.fullmatch(came.strip()):
        return " (write the number alone, without a unit)"
    return ""


def is_number(came: str) -> bool:
    """Return whether a text is a number."""
    try:
        float(came)
    except ValueError:
        return False
    return True
