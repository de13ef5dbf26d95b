"""The page of a cell of real daemons: on its own, and in a browser if Chromium is installed."""

import signal

import pytest
from browser import CHROMIUM, new_page, open_browser
from command_line import begin, environment
from fleet_cell import CELL, RunningCell
from page import page_at

from orientd.motion_file import parse
from orientd.protocol import control_pb2 as pb

pytest.importorskip("zenoh")
pytest.importorskip("websockets")

in_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="pages are tested in Chromium: install it (Debian: chromium)"
)

LONG = parse({"keyframes": [{"rotation_vector": [0, 0, 3.0]}], "limits": {"velocity": 0.1}})


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    folder.chmod(0o700)
    with RunningCell(folder, 2, lease=10.0) as cell:
        yield cell


@pytest.fixture(scope="module")
def page(cell):
    variables = environment(ORIENTD_FLEET=cell.endpoint, ORIENTD_CELL=CELL)
    view = begin("fleet", "view", "--no-open", "--port", 0, env=variables)
    try:
        line = view.stdout.readline()
        assert line.startswith("ready"), (line, view.stderr.read())
        pytest.importorskip("playwright.sync_api")
        with open_browser() as browser:
            page = new_page(browser, 600, 400)
            page.goto(f"{line.split()[-1]}")
            yield page
    finally:
        view.terminate()
        ended = view.communicate(timeout=15.0)
    assert (view.returncode, *ended) == (0, "", "")


def test_a_page_keeps_up_with_its_cell_and_stops_all(cell):
    variables = environment(ORIENTD_FLEET=cell.endpoint, ORIENTD_CELL=CELL)
    view = begin("fleet", "view", "--no-open", "--port", 0, env=variables)
    try:
        line = view.stdout.readline()
        assert line.startswith("ready"), (line, view.stderr.read())
        with cell.fleet() as fleet, page_at(line.split()[-1]) as page:
            robots = [fleet.robot(name) for name in cell.names]
            moves = [robot.move(LONG) for robot in robots]
            page.until(lambda page: states(page).count("Moving") == 2, "motion on the page")
            page.ask("stop")
            assert [move.wait(20.0, check=False).outcome for move in moves] == [
                pb.OUTCOME_STOPPED
            ] * 2
            page.until(lambda page: states(page).count("Holding") == 2, "rest on the page")
            assert len(page.told["tools"]) == 2
            for robot in robots:
                robot.close()
    finally:
        view.terminate()
        ended = view.communicate(timeout=15.0)
    assert (view.returncode, *ended) == (0, "", "")


def states(page):
    """Return what each device of the page does, in a word."""
    return [one.split()[-1] for kind, one, _ in page.told.get("status", ()) if kind == "current"]


def said(page, text):
    """Return where the panel says *text*; the list of what is drawn has the same names."""
    return page.locator("b", has_text=text)


@pytest.mark.slow
@in_browser
def test_the_page_shows_every_daemon_and_one_button_stops_all(cell, page):
    for name in cell.names:
        said(page, name).wait_for()
    with cell.fleet() as fleet:
        robots = [fleet.robot(name) for name in cell.names]
        moves = [robot.move(LONG) for robot in robots]
        said(page, "Moving").nth(1).wait_for(state="attached")
        button = page.get_by_role("button", name="Stop all")
        button.evaluate("button => button.click()")
        assert [move.wait(20.0, check=False).outcome for move in moves] == [pb.OUTCOME_STOPPED] * 2
        said(page, "Holding").nth(1).wait_for(state="attached")
        for robot in robots:
            robot.close()


@pytest.mark.slow
@in_browser
def test_a_daemon_that_is_gone_is_said_to_be_unknown_and_comes_back(cell, page):
    cell.end("arm-2", signal.SIGKILL)
    page.get_by_text("arm-2 has left").wait_for()
    said(page, "Unknown").wait_for(state="attached")
    assert said(page, "Holding").count() == 1
    cell.start("arm-2")
    cell.await_ready("arm-2")
    said(page, "Unknown").wait_for(state="detached")
