"""``orientd view`` and its page in a browser."""

import contextlib
import shutil

from command_line import begin

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

# As the page is drawn without a graphics card.
SOFTWARE = (
    "--no-sandbox",
    "--disable-gpu-compositing",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
PATIENCE = 30_000
"""ms; a browser on a busy machine."""


@contextlib.contextmanager
def open_browser():
    """Start Chromium."""
    from playwright import sync_api

    with sync_api.sync_playwright() as player:
        opened = player.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield opened
        opened.close()


@contextlib.contextmanager
def view_of(socket):
    """Begin ``orientd view``, which must end in order."""
    process = begin("view", "--no-open", "--port", 0, "--socket", socket)
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
    """Return a page that is drawn ten times a second at most, as on a slow machine."""
    opened = browser.new_page(viewport={"width": width, "height": height})
    opened.set_default_timeout(PATIENCE)
    opened.add_init_script(
        "const draw = window.requestAnimationFrame.bind(window);"
        "window.requestAnimationFrame = (work) => setTimeout(() => draw(work), 90);"
        "window.cancelAnimationFrame = clearTimeout.bind(window);"
    )
    return opened


@contextlib.contextmanager
def page_of(view, browser, width, height):
    """Open a page in a small window, of which a processor can draw enough."""
    opened = new_page(browser, width, height)
    opened.goto(f"{view.address}/?fixedDpr=0.5")
    # No state is shown before the first pictures are drawn, which may take long without a card.
    timely = "document.body.matches('.is-timely:not(.is-stale)')"
    opened.wait_for_function(timely, polling=100, timeout=4 * PATIENCE)
    try:
        yield opened
    finally:
        opened.close()
