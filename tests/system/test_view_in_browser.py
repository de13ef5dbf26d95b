"""The page of `orientd view` in a browser; skipped without Chromium."""

import base64
import io
import os
import signal

import numpy as np
import pytest
from browser import CHROMIUM, open_browser, page_of, view_of
from gimbal_bench import await_hold
from harness import spin, until

from orientd.protocol import control_pb2 as pb

image = pytest.importorskip("matplotlib.image")
pytest.importorskip("playwright.sync_api")

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="pages are tested in Chromium: install it (Debian: chromium)"
)


@pytest.fixture(scope="module")
def browser():
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def view(daemon):
    with view_of(daemon.socket) as process:
        yield process


@pytest.fixture(scope="module")
def page(view, browser):
    with page_of(view, browser, 900, 400) as opened:
        yield opened


def press(page, name):
    """Press a button at once, without waiting for the page to stand still, which it never does."""
    press_button(page.get_by_role("button", name=name))


def press_button(button):
    button.wait_for()
    until(button.is_enabled, "a button that can be pressed", seconds=30.0)
    button.evaluate("button => button.click()")


def test_the_page_draws_the_axes_and_the_charts(page):
    page.get_by_text("Holding").wait_for()
    page.locator("canvas.chart").nth(3).wait_for()
    assert page.locator("canvas.chart").count() == 4
    camera = page.context.new_cdp_session(page)

    def shows_all_axes():
        # As it is: the page itself is photographed only once it has stood still.
        shot = camera.send("Page.captureScreenshot")["data"]
        pixels = image.imread(io.BytesIO(base64.b64decode(shot)))[:, :450, :3]
        red, green, blue = (pixels[..., k] for k in range(3))
        x = (red > green + 0.25) & (red > blue + 0.25)
        y = (green > red + 0.15) & (green > blue + 0.05)
        z = (blue > red + 0.25) & (blue > green + 0.1)
        return all(np.count_nonzero(axis) > 50 for axis in (x, y, z))

    until(shows_all_axes, "the axes", seconds=30.0)


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_nothing_is_cut_off_on_a_desk_or_a_phone(view, browser, width, height):
    with page_of(view, browser, width, height) as page:
        page.get_by_text("Holding").wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate("get('panel').scrollWidth <= get('panel').clientWidth")
        stop = page.get_by_role("button", name="Stop").bounding_box()
        assert stop["x"] >= 0
        assert stop["x"] + stop["width"] <= width
        assert stop["y"] + stop["height"] <= height


def test_the_stop_button_stops_a_motion_of_somebody_else(daemon, page):
    daemon.token = daemon.stub.AcquireLease(pb.AcquireLeaseRequest(holder="ana")).lease.token
    stream = daemon.move(spin(60.0))
    page.get_by_text("Moving").wait_for()
    page.get_by_text("held by ana").wait_for()
    daemon.renew()
    press(page, "Stop")
    *_, last = stream
    assert last.summary.outcome == pb.OUTCOME_STOPPED
    assert f"(user:{os.getuid()})" in last.summary.text.partition("stopped by")[2]


def test_a_stop_that_a_servo_does_not_answer_stays_on_the_page_until_one_is(daemon, page):
    pid = daemon.device().servo_pid
    os.kill(pid, signal.SIGSTOP)
    try:
        press(page, "Stop")
        silent = page.get_by_text(
            "Not stopped: no servo of arm answers the stop: it may still move"
        )
        silent.wait_for()
    finally:
        os.kill(pid, signal.SIGCONT)
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "a servo that goes on")
    press(page, "Stop")
    silent.wait_for(state="hidden")
    page.get_by_text("Holding").wait_for()
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))


def drag(page, path, *kinds):
    """Have a file dragged as by somebody's hand; the page only hears of it from the browser."""
    files = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
    session = page.context.new_cdp_session(page)
    for kind in kinds:
        session.send("Input.dispatchDragEvent", {"type": kind, "x": 100, "y": 100, "data": files})


def test_a_file_that_is_dropped_does_not_replace_the_page(page, tmp_path):
    path = tmp_path / "dropped.yaml"
    path.write_text("keyframes: []\n")
    drag(page, path, "dragEnter", "dragOver", "drop")
    page.wait_for_timeout(500.0)
    assert page.url.startswith("http://127.0.0.1:")
    page.get_by_text("Holding").wait_for()


def test_the_lease_is_taken_and_given_back_and_the_page_names_what_moves_the_device(page):
    press(page, "Take the lease")
    page.get_by_text("held by this view").wait_for()
    press(page, "Give the lease back")
    page.get_by_text("free", exact=True).wait_for()
    page.get_by_text("orientd move FILE").wait_for()


@pytest.mark.parametrize("frozen", ["page", "daemon", "servo"])
def test_a_page_of_which_anything_stands_still_never_says_ready(daemon, view, page, frozen):
    pids = {
        "page": view.pid,
        "daemon": daemon.process.pid,
        "servo": daemon.device().servo_pid,
    }
    page.get_by_text("ready to move").wait_for()
    os.kill(pids[frozen], signal.SIGSTOP)
    try:
        page.get_by_text("ready to move").wait_for(state="hidden")
    finally:
        os.kill(pids[frozen], signal.SIGCONT)
    await_hold(daemon, "arm")
    page.get_by_text("ready to move").wait_for()


def test_the_page_says_when_the_daemon_is_gone_and_when_it_is_back(daemon, page):
    assert daemon.end() == 0
    page.get_by_text("Not connected").wait_for()
    page.get_by_text("Last measured").wait_for(state="hidden")
    daemon.start()
    page.get_by_text("Not connected").wait_for(state="detached")
    page.get_by_text("Holding").wait_for()
