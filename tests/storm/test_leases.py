"""Leases of two users with four terminals and two devices, at random.

``ORIENTD_STORM_SEQUENCES`` sets the number of sequences (500), ``ORIENTD_STORM_SEED`` the first.
Run by ``make storm``, or: ``python -m pytest tests/storm/test_leases.py -m storm --timeout=0 -s``.
"""

import json
import os
import random
import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from harness import DEVICE, DaemonProcess, until

from orientd.protocol import control_pb2 as pb

pytestmark = [
    pytest.mark.storm,
    pytest.mark.skipif(os.getuid() != 0, reason="becomes another user, which root may"),
]

SEQUENCES = int(os.environ.get("ORIENTD_STORM_SEQUENCES", "500"))
SEED = int(os.environ.get("ORIENTD_STORM_SEED", "1"))
ACTS = 8
KINDS = [
    *(6 * ["move"] + 4 * ["queue"] + 3 * ["share"] + 2 * ["refused"]),
    *("cancel", "kill", "seize", "release", "stop"),
]
DEVICES = (DEVICE, "leg")
OTHER = 54302
LEASE = 2.0
ENDED = re.compile(r"(\w+): motion (done|stopped|replaced|unsettled) (\d+)(?:: (.*))?$")
BEGUN = re.compile(r"(\w+): motion (\d+) is commanded by .* \(user:(\d+)\)$")


class Terminal:
    """A process of one user that reads commands."""

    def __init__(self, name, daemon, uid):
        self.name, self.daemon, self.uid = name, daemon, uid
        self.share = ""
        self._begin()

    def _begin(self):
        program = Path(__file__).with_name("terminal.py")
        self.process = subprocess.Popen(
            [sys.executable, str(program), str(self.daemon.socket), str(self.uid)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert json.loads(self.process.stdout.readline()) == "ready"

    def do(self, *asked):
        print(json.dumps(asked), file=self.process.stdin, flush=True)
        return json.loads(self.process.stdout.readline())

    def end(self):
        self.process.kill()
        self.process.communicate()

    def again(self):
        self.end()
        self._begin()


class Storm:
    """What is done, and what may therefore end."""

    def __init__(self, daemon, terminals, generator):
        self.daemon, self.terminals, self.any = daemon, terminals, generator
        self.owner = {}  # the terminal of each motion
        self.reasons = {}  # what may end a motion: by (device, number), or by device
        self.tally = Counter()

    def permit(self, key, text):
        self.reasons.setdefault(key, []).append(text)

    def act(self):
        one, device = self.any.choice(self.terminals), self.any.choice(DEVICES)
        kind = self.any.choice(KINDS)
        self.tally[kind] += 1
        user = f"(user:{one.uid})"
        mine = [key for key, owner in self.owner.items() if owner is one]
        if kind in ("move", "queue"):
            seconds, angle = self.any.uniform(0.3, 1.5), self.any.uniform(0.05, 0.3)
            answer = one.do("move", device, seconds, kind == "queue", angle)
            if "is" in answer:
                self.owner[device, answer["is"]] = one
            else:
                self.tally["refused by the lease"] += "lease" in answer["error"]
        elif kind == "refused":
            assert "error" in one.do("refused", device, self.any.random() < 0.5)
        elif kind == "cancel" and mine:
            key = self.any.choice(mine)
            self.permit(key, f"stopped by .*{re.escape(user)}")
            one.do("cancel", *key)
        elif kind == "kill":
            for key in mine:
                self.permit(key, "its caller has gone away|the lease of .* has expired")
            self.permit(one, "")
            one.again()
        elif kind == "seize":
            self.permit(device, f"the lease of .* was seized by .*{re.escape(user)}: a storm")
            one.do("seize", device)
        elif kind == "release":
            for key in mine:
                self.permit(key, "the lease of .* was released")
            one.do("release")
        elif kind == "stop":
            self.permit(device, f"stopped by .*{re.escape(user)}")
            one.do("stop", device)
        elif kind == "share":
            one.do("share", device)

    def judge(self, log):
        """Check that only permitted clients ended the motions in *log*."""
        ends = {}
        for line in log.splitlines():
            begun, ended = BEGUN.search(line), ENDED.search(line)
            if begun:
                device, number, uid = begun.groups()
                owner = self.owner.get((device, int(number)))
                assert owner is None or owner.uid == int(uid), line
            if ended:
                device, kind, number, text = ended.groups()
                ends[device, int(number)] = kind, text or "", line
        for (device, number), (kind, text, line) in ends.items():
            self.tally[kind] += 1
            owner = self.owner.get((device, number))
            if kind == "replaced" and owner is not None:
                # By another motion of the same commander.
                by = [
                    two
                    for (of, later), two in self.owner.items()
                    if of == device and later > number
                ]
                assert not by or any(two.uid == owner.uid for two in by), line
            if kind != "stopped":
                continue
            # A withdrawn motion takes the motions queued behind it with it.
            behind = [key for key in self.owner if key[0] == device and key[1] <= number]
            may = [*self.reasons.get(device, ())]
            for key in [(device, number), *behind]:
                may += self.reasons.get(key, ())
            is_killed = (device, number) not in self.owner and "gone away" in text
            assert is_killed or any(re.match(reason, text) for reason in may), (line, may)


@pytest.fixture
def daemon(open_folder):
    process = DaemonProcess(open_folder, lease=LEASE, patience=30.0, others=["leg"])
    text = process.config.read_text()
    process.config.write_text(f"[access.users]\n{OTHER} = 'administrator'\n{text}\n")
    with process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


def test_no_motion_ends_but_by_whom_it_may_be_ended(daemon):
    terminals = [Terminal(f"t{k}", daemon, uid) for k, uid in enumerate((0, 0, OTHER, OTHER))]
    tally, path = Counter(), daemon.folder / "log"
    try:
        for sequence in range(SEED, SEED + SEQUENCES):
            read = path.stat().st_size
            storm = Storm(daemon, terminals, random.Random(sequence))
            for _ in range(ACTS):
                storm.act()
                time.sleep(storm.any.uniform(0.0, 0.3))
            # A motion that is accepted only now rests until it begins: it has to have ended.
            until(lambda at=read: not unended(since(path, at)) and all(at_rest(daemon)), "rest")
            for one in terminals:
                one.do("release")
            assert_none_at_fault(daemon)
            try:
                storm.judge(since(path, read))
            except AssertionError as error:
                raise AssertionError(f"sequence {sequence}: {error}") from error
            tally += storm.tally
    finally:
        for one in terminals:
            one.end()
    print(f"\n{SEQUENCES} sequences: {dict(tally)}")


def since(path, at):
    with path.open() as log:
        log.seek(at)
        return log.read()


def unended(log):
    """Return the motions of *log* that have begun and not ended: device and number."""
    lines = log.splitlines()
    begun = {found.group(1, 2) for found in map(BEGUN.search, lines) if found}
    return begun - {found.group(1, 3) for found in map(ENDED.search, lines) if found}


def at_rest(daemon):
    return [
        report.state in (pb.STATE_HOLDING, pb.STATE_FAULT)
        for report in daemon.stub.GetState(pb.GetStateRequest()).devices
    ]


def assert_none_at_fault(daemon):
    devices = daemon.stub.GetState(pb.GetStateRequest()).devices
    assert [report.fault_text for report in devices] == [""] * len(devices)
