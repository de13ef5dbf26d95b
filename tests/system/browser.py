"""``orientd view`` and its page in a browser."""

import contextlib
import shutil

from command_line import begin

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

PATIENCE = 30_000
"""ms; a browser on a busy machine."""


@contextlib.contextmanager
def open_browser():
    """Start Chromium."""
    from playwright import sync_api

    with sync_api.sync_playwright() as player:
        opened = player.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@contextlib.contextmanager
def view_of(socket, *arguments):
    """Begin ``orientd view``, which must end in order."""
    where = () if socket is None else ("--socket", socket)
    process = begin("view", "--no-open", "--port", 0, *where, *arguments)
    line = process.stdout.readline()
    assert line.startswith("ready"), (line, process.stderr.read())
    process.address = line.split()[-1]
    try:
        yield process
    finally:
        process.terminate()
        ended = process.communicate(timeout=15.0)
    assert (process.returncode, *ended) == (0, "", "")


def new_page(browser, width, height):
    """Return a page that is patient with a busy machine."""
    opened = browser.new_page(viewport={"width": width, "height": height})
    opened.set_default_timeout(PATIENCE)
    return opened


@contextlib.contextmanager
def page_of(view, browser, width, height):
    """Open the page of a view."""
    opened = new_page(browser, width, height)
    opened.goto(view.address)
    try:
        yield opened
    finally:
        opened.close()
