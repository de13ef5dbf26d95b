"""Files that are dropped anywhere on the page go where those that are chosen go.

The library has a button to choose a file and nothing that takes a dropped one: a browser would
leave the page for the file instead.  The script hands it to the field behind that button.
"""

from __future__ import annotations

from html import escape

_STYLE = """
body.takes-file::after {
  content: "Drop the motion file: it is planned and shown, nothing moves";
  position: fixed; inset: 0.5em; z-index: 10000; pointer-events: none;
  display: flex; align-items: center; justify-content: center; text-align: center;
  border: 3px dashed #4270d8; border-radius: 8px;
  background: rgba(20, 30, 60, 0.75); color: white; font: 600 1.2em sans-serif;
}
"""

_SCRIPT = """
if (!window.takesFiles) {
  window.takesFiles = true;
  const field = () => document.querySelector('input[type=file]');
  const isFile = event => event.dataTransfer && event.dataTransfer.types.includes('Files');
  const canTake = () => field() !== null && !field().nextElementSibling.disabled;
  const mark = isOver => document.body.classList.toggle('takes-file', isOver);
  window.addEventListener('dragover', event => {
    if (!isFile(event)) return;
    event.preventDefault();
    event.dataTransfer.dropEffect = canTake() ? 'copy' : 'none';
    mark(canTake());
  });
  window.addEventListener('dragleave', event => { if (event.relatedTarget === null) mark(false); });
  window.addEventListener('drop', event => {
    if (!isFile(event)) return;
    event.preventDefault();
    mark(false);
    if (!canTake() || event.dataTransfer.files.length === 0) return;
    field().files = event.dataTransfer.files;
    field().dispatchEvent(new Event('change', {bubbles: true}));
  });
}
"""

# A script that is put into a page as HTML is never run; what an element does on an event is, but
# there plain names mean the element's own.
HTML = (
    f'<style onload="{escape(_SCRIPT)}">{_STYLE}</style>'
    '<div style="padding:0 0.8em 0.5em;font-size:0.875em;opacity:0.72">'
    "Or drop it anywhere on this page.</div>"
)
"""For an element of the page, once."""
