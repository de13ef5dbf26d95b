"""Marks what a page shows as old once nothing new has come for a second, whoever has stopped.

The process that serves the page cannot say that it stands still, so the browser watches: the page's
loop tells it a new number several times a second, and a script marks the page where that stays out.
"""

from __future__ import annotations

from html import escape

from orientd.rpc import STALE

SEEN = "orientd-seen"
"""Class of what is shown in grey while it is old."""

STATE = "orientd-state"
"""Class of what is not shown at all while it is old: an old "ready" would be believed."""

BEATS_HZ = 5.0
"""How often the page's loop says that it is there."""

_STYLE = f"""
body.is-stale canvas, body.is-stale .uplot, body.is-stale .{SEEN} {{
  filter: grayscale(1); opacity: 0.4;
}}
body.is-stale .{STATE} {{ visibility: hidden; }}
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
  let last = null, since = performance.now();
  setInterval(() => {{
    const now = performance.now(), found = document.querySelector('[data-beat]');
    if (found !== null && found.dataset.beat !== last) {{
      last = found.dataset.beat;
      since = now;
    }}
    const silent = (now - since) / 1000, isStale = silent > {STALE:g};
    if (isStale) banner.textContent =
      `✕ Nothing new for ${{silent.toFixed(0)}} s: what is shown is old`;
    document.body.classList.toggle('is-stale', isStale);
  }}, 100);
}}
"""

# As in `drop`: an element's own event is what runs a script of a page that is put in as HTML.
HTML = f'<style onload="{escape(_SCRIPT)}">{_STYLE}</style>'
"""For an element of the page, once."""


def beat(number: int) -> str:
    """Return what tells the page that its loop is there, as HTML; another number each time."""
    return f'<span hidden data-beat="{number}"></span>'
