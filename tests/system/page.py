"""A page of ``orientd view`` without a browser: what the server sends, and what it is asked."""

import contextlib
import json
import time

from websockets.sync.client import connect


class Page:
    """One open page."""

    def __init__(self, connection):
        self.connection, self.told, self.answers = connection, {}, []

    def ask(self, what, **more):
        self.connection.send(json.dumps({"do": what, **more}))

    def hear(self):
        """Take in the next message."""
        news = json.loads(self.connection.recv(timeout=10.0))
        if "said" in news:
            self.told |= news
        else:
            self.answers.append(news)

    def until(self, condition, what, seconds=30.0):
        """Take messages in until *condition* of the page is true; return what it returns."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = condition(self)
            if found:
                return found
            self.hear()
        raise AssertionError(f"{what}: not within {seconds} s; {self.lines} {self.answers}")

    @property
    def lines(self):
        """What the head of the page says, a text for each line."""
        return [" ".join(line[1:]) for line in self.told.get("status", ())]

    def says(self, text):
        return any(text in line for line in self.lines)

    def await_line(self, text):
        self.until(lambda page: page.says(text), text)

    @property
    def enabled(self):
        """The controls that can be used now."""
        return set(self.told["control"]["enabled"])

    @property
    def shown(self):
        """The controls that are there only at times."""
        return set(self.told["control"]["shown"])

    def await_refusal(self, text):
        self.until(lambda page: any(text in one.get("refused", "") for one in page.answers), text)


@contextlib.contextmanager
def page_at(address, **headers):
    """Open the page at an address, as ``orientd view`` prints it."""
    url = address.replace("http://", "ws://")
    with connect(url, additional_headers=headers, max_size=None, open_timeout=30.0) as connection:
        yield Page(connection)
