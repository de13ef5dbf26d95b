"""The search of the site: questions of readers find the page that answers them first."""

import functools
import http.server
import shutil
import subprocess
import sys
import threading

import pytest
from pages import DOCS
from system.browser import CHROMIUM, PATIENCE, open_browser

sys.path.insert(0, str(DOCS))

from generators.searched import WORDS

QUESTIONS = {
    "velocity limit": "how-to/limits",
    "set a velocity limit": "how-to/limits",
    "lease": "how-to/access",
    "moving target": "how-to/look-at",
    "own gimbal": "how-to/real-gimbal",
    "limit_guard": "reference/messages",
    "record": "tutorials/record-replay",
    "boot": "how-to/service",
    "run at boot": "how-to/service",
    "certificate": "explanation/limits",
    "blend": "how-to/on-the-way",
    "blend two moves": "how-to/on-the-way",
    "ROS order": "how-to/library",
    "ROS order pose": "how-to/library",
    "emergency stop": "how-to/on-the-way",
    "set speed limit": "how-to/limits",
    "arm jerks when I retarget": "how-to/on-the-way",
    "connect a UR5e": "how-to/real-ur",
    "camera gimbal park": "how-to/real-gimbal",
    "who may stop": "how-to/access",
    "safety": "explanation/limits",
    "reset after a protective stop": "how-to/real-ur",
    "quaternion order": "how-to/library",
    "slow down": "how-to/on-the-way",
    "stop": "how-to/on-the-way",
    "park": "how-to/real-gimbal",
    "remote control": "how-to/real-ur",
    "permissions": "how-to/access",
}


def test_every_searched_word_has_one_page_that_is_there():
    words = [word for page in WORDS.values() for word in page]
    assert len(set(words)) == len(words)
    assert [word for word in words if word != word.lower()] == []
    assert [page for page in WORDS if not (DOCS / f"{page}.md").is_file()] == []


class _Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files without a line for each."""

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The address of the site, made of these sources."""
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(DOCS), str(folder)]
    subprocess.run(command, check=True)
    handler = functools.partial(_Quiet, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
    shutil.rmtree(folder)


@pytest.mark.follow
def test_a_question_finds_its_page_at_the_first_click(site):
    found = {}
    with open_browser() as browser:
        page = browser.new_page()
        for question in QUESTIONS:
            page.goto(f"{site}/search.html?q={question.replace(' ', '+')}")
            first = page.wait_for_selector("ul.search li a", timeout=PATIENCE)
            found[question] = first.get_attribute("href").partition(".html")[0]
    assert found == QUESTIONS
