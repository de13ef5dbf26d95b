"""Marks what a page shows as old once nothing new has come for a second, whoever has stopped.

The process that serves the page cannot say that it stands still, so the browser watches: the page's
loop tells it several times a second when that was said and how old then was what is shown, and a
script marks the page where the sum is too old.  A browser that is busy takes things in late, which
counts as well: the clocks of both may differ, but not by more than the quickest way of late shows.
A browser without a graphics card may stand still for seconds over its first pictures, the script as
well, so no state is shown before the script has kept time for a while.
"""

from __future__ import annotations

from html import escape

from orientd.rpc import STALE

SEEN = "orientd-seen"
"""Class of what is shown in grey while it is old."""

STATE = "orientd-state"
"""Class of what is not shown at all while it is old: an old "ready" would be believed."""

BEATS_HZ = 10.0
"""How often the page's loop says that it is there, and how old what is shown is."""

_LATE, _SMOOTH, _LONGEST = 0.5, 1.5, 10.0
"""A browser keeps time where the script was not that late for that long, or after the last, s."""

_STYLE = f"""
body.is-stale canvas, body.is-stale .uplot, body.is-stale .{SEEN} {{
  filter: grayscale(1); opacity: 0.4;
}}
body.is-stale .{STATE}, body:not(.is-timely) .{STATE} {{ visibility: hidden; }}
#orientd-stale {{
  display: none; position: fixed; top: 0; left: 0; right: 0; z-index: 9999; pointer-events: none;
  padding: 0.5em; background: #c03a17; color: white; font: 600 1.1em sans-serif; text-align: center;
}}
body.is-stale #orientd-stale {{ display: block; }}
"""

_SCRIPT = f"""
if (!window.watchesBeats) {{
  window.watchesBeats = true;
  const banner = document.createElement('div');
  banner.id = 'orientd-stale';
  banner.setAttribute('role', 'alert');
  document.body.append(banner);
  // The least time on the way includes what the clocks differ by, and is of the last minute.
  let last = null, known = null, least = Infinity, before = Infinity, begun = 0;
  const started = performance.now() / 1000;
  let ticked = started, late = started;
  setInterval(() => {{
    const now = performance.now() / 1000, found = document.querySelector('[data-said]');
    if (now - ticked > {_LATE:g}) late = now;
    ticked = now;
    if (now - late > {_SMOOTH:g} || now - started > {_LONGEST:g})
      document.body.classList.add('is-timely');
    if (found !== null && found.dataset.said !== last) {{
      last = found.dataset.said;
      known = last - found.dataset.age;
      if (now - begun > 30) {{
        before = least;
        least = Infinity;
        begun = now;
      }}
      least = Math.min(least, now - last);
    }}
    if (known === null) return;
    const age = now - known - Math.min(least, before), isStale = age > {STALE:g};
    if (isStale) banner.textContent =
      `✕ Nothing new for ${{age.toFixed(0)}} s: what is shown is old`;
    document.body.classList.toggle('is-stale', isStale);
  }}, 50);
}}
"""

# As in `drop`: an element's own event is what runs a script of a page that is put in as HTML.
HTML = f'<style onload="{escape(_SCRIPT)}">{_STYLE}</style>'
"""For an element of the page, once."""


def beat(now: float, age: float) -> str:
    """Return what tells the page how old it is, as HTML; another one each time.

    Args:
        now: s on :func:`time.monotonic`.
        age: of what is shown, s.
    """
    return f'<span hidden data-said="{now:.3f}" data-age="{age:.3f}"></span>'
