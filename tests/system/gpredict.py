"""gpredict on a screen of its own: one satellite, one place, and a rotator that it reaches."""

import contextlib
import socket
import subprocess
import threading
import time

from desktop import Desktop

FILES = {
    "gpredict.cfg": """
[TLE]
AUTO_UPDATE_FREQ=0
[GLOBAL]
DEFAULT_QTH=site.qth
OPEN_MODULES=passes
[MODULES]
GRID=3;0;1;0;1
""",
    "site.qth": "[QTH]\nLOCATION=Site\nLAT={latitude:.6f}\nLON={longitude:.6f}\nALT={height}\n",
    "modules/passes.mod": "[GLOBAL]\nSATELLITES={number};\nQTHFILE=site.qth\n",
    "satdata/{number}.sat": """
[Satellite]
NAME=TEST
NICKNAME=TEST
TLE1={first}
TLE2={second}
""",
    "satdata/own.cat": "Own\n{number}\n",
    "hwconf/rotator.rot": """
[Rotator]
Host=127.0.0.1
Port={port}
AzType=0
MinAz=0
MaxAz=360
MinEl=0
MaxEl=90
Cycle={cycle}
Threshold={threshold}
""",
    "trsp/none": "",
    "satdata/cache/none": "",
}
"""By name in gpredict's folder.  The view shows one satellite as text, which costs little."""


class Wire:
    """Passes what gpredict and a server say on to each other; a context manager.

    Attributes:
        port: for gpredict.
        asked: the time, in s since the epoch, azimuth and elevation of each position it sent.
        answers: of the server.
    """

    def __init__(self, server):
        """*server* is the port to pass to."""
        self.asked, self.answers = [], []
        self._server = socket.create_connection(("127.0.0.1", server))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        for end in (self._listener, self._server):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()
        self._server.close()

    def _serve(self):
        with contextlib.suppress(OSError):
            program, _ = self._listener.accept()
            with program:
                back = threading.Thread(target=self._pass_back, args=(program,))
                back.start()
                while sent := program.recv(4096):
                    for line in sent.decode().splitlines():
                        if line.startswith("P "):
                            self.asked.append((time.time(), *map(float, line.split()[1:])))
                    self._server.sendall(sent)
                self._server.shutdown(socket.SHUT_RDWR)
                back.join()

    def _pass_back(self, program):
        with contextlib.suppress(OSError):
            while answer := self._server.recv(4096):
                self.answers += answer.decode().splitlines()
                program.sendall(answer)


def configure(home, *, elements, place, port, cycle, threshold):
    """Write gpredict's files.

    *elements* are the two lines of a satellite, *place* is latitude and longitude in degrees and
    height in m, *cycle* is in ms and *threshold* in degrees.
    """
    latitude, longitude, height = place
    facts = {
        "latitude": latitude, "longitude": longitude, "height": round(height),
        "first": elements[0], "second": elements[1], "number": int(elements[0][2:7]),
        "port": port, "cycle": cycle, "threshold": threshold,
    }  # fmt: skip
    for name, text in FILES.items():
        path = home / ".config" / "Gpredict" / name.format(**facts)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.lstrip().format(**facts))


@contextlib.contextmanager
def engaged(home, **settings):
    """Run gpredict until it tracks its satellite with its rotator; yield the desktop.

    See :func:`configure` for the settings.
    """
    home.mkdir()
    configure(home, **settings)
    with Desktop(home) as desktop, (home / "log").open("wb") as log:
        program = subprocess.Popen(["gpredict"], env=desktop.environment, stdout=log, stderr=log)
        try:
            widgets = desktop.widgets()
            # The button of a module's menu has a picture and no name; it is the first one.
            desktop.click(widgets.find("frame", "Gpredict: passes").find("push button"))
            desktop.click(widgets.find("menu item", "Antenna Control"))
            window = widgets.find("frame", "Gpredict Rotator Control: passes")
            for name in ("Track", "Engage"):
                desktop.click(window.find("toggle button", name))
            yield desktop
        finally:
            program.kill()  # at SIGTERM, gpredict sometimes waits for itself for ever
            program.wait()
