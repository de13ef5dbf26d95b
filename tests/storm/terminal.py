"""A terminal: a client of a daemon that reads commands from standard input, a JSON list a line.

``python terminal.py SOCKET UID``.
"""

import contextlib
import json
import os
import sys

import orientd
import orientd.client.move_handle
import orientd.client.robot
import orientd.client.stop_call
import orientd.client.trust
from orientd.errors import OrientdError


class Terminal:
    """The commands of the terminal; every answer is a JSON value."""

    def __init__(self, robot):
        self.robot, self.moves = robot, {}

    def move(self, device, seconds, queue, angle):
        keyframes = [
            {"time": 0.0, "rotation_vector": [0.0, 0.0, angle]},
            {"time": seconds, "rotation_vector": [0.3, 0.0, -angle]},
        ]
        handle = self.robot.move(keyframes, device=device, queue=queue, approach=True)
        self.moves[device, handle.motion_number] = handle
        return handle.motion_number

    def refused(self, device, queue):
        self.robot.move([{"rotation_vector": [0.0, 0.0, 1.0]}], device=device, queue=queue,
                        limits={"velocity": 1e9})  # fmt: skip

    def cancel(self, device, number):
        handle = self.moves.get((device, number))  # else the motion of a killed terminal
        if handle is not None:
            handle.cancel()

    def share(self, device):
        self.robot.acquire_lease(device, beside=True)

    def seize(self, device):
        self.robot.seize_lease("a storm", device)

    def release(self):
        self.robot.release_lease()

    def stop(self, device):
        return [report.name for report in self.robot.stop(device)]


def main(socket, uid):
    # After the change of user, Python may not be able to load further modules.
    with contextlib.suppress(OrientdError), orientd.connect(socket) as robot:
        robot.plan([{"rotation_vector": [0.1, 0.0, 0.0]}], device=robot.devices()[0].name)
    if uid:
        os.setgroups([])
        os.setgid(uid)
        os.setuid(uid)
    with contextlib.closing(orientd.connect(socket)) as robot:
        terminal = Terminal(robot)
        print(json.dumps("ready"), flush=True)
        for line in sys.stdin:
            name, *arguments = json.loads(line)
            try:
                answer = {"is": getattr(terminal, name)(*arguments)}
            except OrientdError as error:
                answer = {"error": str(error)}
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
