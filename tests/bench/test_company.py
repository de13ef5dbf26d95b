"""The servo's punctuality with many watching clients and without, in paired slots."""

import contextlib
import shutil
import signal
import statistics
import sys
import threading
import urllib.request

import busy_clients
import pytest
from bare_loop import processes
from command_line import begin, environment
from harness import free_port, until
from servo_lateness import DEVICE, PRIORITY, daemon, stream
from test_servo import show

from orientd.config import SPIN_US

pytest.importorskip("websockets")
pytest.importorskip("prometheus_client")
playwright = pytest.importorskip("playwright.sync_api")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.bench,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (Debian: chromium)"),
]

RATE_HZ, PAIRS, SECONDS = 500.0, 6, 10.0
PAGES = 2
# As a page is drawn without a graphics card, by the same processor that the servo has.
SOFTWARE = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextlib.contextmanager
def pages(control):
    """Have pages open, each of which shows the device."""
    view = begin("view", "--no-open", "--port", 0, "--socket", control)
    try:
        address = view.stdout.readline().split()[-1]
        with playwright.sync_playwright() as player:
            browser = player.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
            for _ in range(PAGES):
                # In a window of its own, or the browser would hold those behind still.
                opened = browser.new_context(viewport={"width": 900, "height": 400}).new_page()
                opened.set_default_timeout(120_000)
                opened.goto(f"{address}/?fixedDpr=0.5")
                opened.get_by_text("Holding").wait_for()
            yield
            browser.close()
    finally:
        view.terminate()
        view.communicate(timeout=30.0)


@contextlib.contextmanager
def recorder(control, path):
    """Record all there is to *path*."""
    process = begin("record", path, env=environment(ORIENTD_SOCKET=str(control)))
    try:
        until(lambda: path.exists() and path.stat().st_size > 0, "a recording", 60.0)
        yield
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30.0)


@contextlib.contextmanager
def scraper(port):
    """Scrape the metrics each second."""
    ending, scraped = threading.Event(), []

    def scrape():
        while not ending.wait(1.0):
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
                scraped.append(len(answer.read()))

    thread = threading.Thread(target=scrape)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()
    assert len(scraped) >= SECONDS / 2


@contextlib.contextmanager
def company(control, port, path):
    """Have everybody look."""
    watchers = [sys.executable, busy_clients.__file__, str(control), DEVICE, "watch"]
    with processes([watchers]), recorder(control, path), scraper(port), pages(control):
        yield


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("spin_us", [SPIN_US, 0])
def test_who_looks_does_not_make_the_servo_late(tmp_path, spin_us):
    port, slots = free_port(), {"alone": [], "in company": []}
    metrics = f"[metrics]\nport = {port}\n"
    with daemon(tmp_path, RATE_HZ, PRIORITY, spin_us, more=metrics) as control:
        stream(control, 2.0, PRIORITY)  # what is loaded with the first motion is loaded
        for number in range(PAIRS):
            for name in sorted(slots, reverse=number % 2 == 1):
                around = (
                    contextlib.nullcontext()
                    if name == "alone"
                    else company(control, port, tmp_path / f"{number}.mcap")
                )
                with around:
                    slots[name].append(stream(control, SECONDS, PRIORITY))
    alone, company_slots = slots["alone"], slots["in company"]
    ratio = statistics.median(
        b.p99_us / a.p99_us for a, b in zip(alone, company_slots, strict=True)
    )
    show(
        f"spin {spin_us} us",
        alone_p99_us=[round(slot.p99_us, 2) for slot in alone],
        company_p99_us=[round(slot.p99_us, 2) for slot in company_slots],
        ratio=round(ratio, 2),
        overruns={name: sum(slot.overruns for slot in found) for name, found in slots.items()},
    )
    assert ratio <= 1.2
