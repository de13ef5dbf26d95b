"""A controller of the tests' own: it speaks as much RTDE as a client needs, and keeps setpoints.

It shares no code with the driver nor with the emulated robot.  Its arm is wherever it was sent.
Run it as ``python wire_reader.py HOST FILE POSE...``: it serves until its input ends, then
writes every pose that arrived to FILE, six doubles each.
"""

import re
import select
import socket
import struct
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

TICK = 0.002
SERVO_L, STOP_SCRIPT = 24, 255
AT_ONCE = {6, 9, 10, 11, 24, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71}
"""Commands of the client's program that it carries out without a word."""
STOPPED, PLAYING = 1, 2
READY, DONE = 1, 2

KINDS = {
    "DOUBLE": "d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "UINT8": "B", "BOOL": "?",
    "VECTOR6D": "6d", "VECTOR3D": "3d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip
NAMES = [
    (r"(in|out)put_int_register_\d+|robot_mode|safety_mode|(async_|)speed_slider_mask|"
     r"payload_mass_int", "INT32"),
    (r"(in|out)put_double_register_\d+|timestamp|speed_scaling|target_speed_fraction|payload|"
     r"actual_momentum|actual_main_voltage|actual_robot_voltage|actual_robot_current|"
     r"standard_analog_.*|speed_slider_fraction|actual_execution_time", "DOUBLE"),
    (r"runtime_state|robot_status_bits|safety_status_bits|safety_status", "UINT32"),
    (r"actual_digital_.*_bits|.*_bits0.*", "UINT64"),
    (r"standard_digital_output.*|configurable_digital_output.*|tool_digital_output.*|"
     r".*_type|.*_mask", "UINT8"),
    (r"payload_cog|actual_tool_accelerometer|payload_inertia.*|elbow_.*", "VECTOR3D"),
    (r"joint_mode", "VECTOR6INT32"),
]  # fmt: skip


def kind_of(name):
    """Return the type of a variable; everything that is not listed is six doubles."""
    if name == "tcp_offset":
        return "NOT_FOUND"
    return next((kind for pattern, kind in NAMES if re.fullmatch(pattern, name)), "VECTOR6D")


class Client:
    """One RTDE connection."""

    def __init__(self, sock):
        self.sock, self.pending = sock, b""
        self.recipes, self.outputs, self.is_started, self.every, self.count = {}, [], False, 1, 0

    def send(self, kind, payload):
        self.sock.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)


class Controller:
    """Registers, a program that plays or not, and the poses that were sent."""

    def __init__(self, pose, joints):
        self.values = {"target_TCP_pose": pose, "actual_TCP_pose": pose, "robot_mode": 7,
                       "target_q": joints, "actual_q": joints, "robot_status_bits": 1,
                       "safety_mode": 1, "safety_status_bits": 1, "runtime_state": STOPPED,
                       "speed_scaling": 1.0, "target_speed_fraction": 1.0}  # fmt: skip
        self.is_executing = False
        self.poses = []

    def tick(self, now):
        """Do what the client's program does in a cycle."""
        values = self.values
        values["timestamp"] = now
        if values["runtime_state"] != PLAYING:
            return
        command = values.get("input_int_register_0", 0)
        if command == 0 or command in AT_ONCE:
            self.is_executing, answer = False, READY
        elif self.is_executing:
            answer = DONE
        elif command == STOP_SCRIPT:
            values["runtime_state"], answer = STOPPED, READY
        else:
            self.is_executing, answer = True, DONE
        values["output_int_register_0"] = answer

    def take(self, client, kind, payload):
        if kind == "V":
            client.send("V", b"\1")
        elif kind == "v":
            client.send("v", struct.pack(">4I", 5, 12, 6, 1))
        elif kind in "OI":
            listed = payload[8 if kind == "O" else 0 :].decode()
            names = [name for name in listed.split(",") if name]
            number = len(client.recipes) + 1 if kind == "I" else 1
            if kind == "O":
                client.outputs = names
                client.every = max(round(1 / (TICK * struct.unpack(">d", payload[:8])[0])), 1)
            else:
                client.recipes[number] = names
            client.send(kind, bytes([number]) + ",".join(map(kind_of, names)).encode())
        elif kind in "SP":
            client.is_started = kind == "S"
            client.send(kind, b"\1")
        elif kind == "U":
            names = client.recipes[payload[0]]
            form = ">" + "".join(KINDS[kind_of(name)] for name in names)
            self.values.update(zip(names, struct.unpack_from(form, payload, 1), strict=True))
            if self.values["input_int_register_0"] == SERVO_L:
                pose = [self.values[f"input_double_register_{k}"] for k in range(6)]
                self.poses.append(pose)
                self.values["target_TCP_pose"] = self.values["actual_TCP_pose"] = pose

    def package(self, names):
        parts = [b"\1"]
        for name in names:
            form = struct.Struct(">" + KINDS[kind_of(name)])
            count = len(form.unpack(bytes(form.size)))
            value = self.values.get(name, [0] * count if count > 1 else 0)
            parts.append(form.pack(*value) if count > 1 else form.pack(value))
        return b"".join(parts)


DASHBOARD = {
    "PolyscopeVersion": "URSoftware 5.12.6.1102099 (Sep 21 2022)",
    "get serial number": "20200000000",
    "is in remote control": "true",
    "stop": "Stopped",
}


def serve(host, controller, ends):
    """Serve the ports of a controller until *ends*, a file, can be read."""
    servers = {socket.create_server((host, port)): port for port in (29999, 30003, 30004)}
    clients, lines = {}, {}
    due = time.monotonic() + TICK
    while True:
        ready, _, _ = select.select(
            [*servers, *clients, *lines, ends], [], [], max(due - time.monotonic(), 0.0)
        )
        for one in ready:
            if one is ends:
                return
            if one in servers:
                sock, port = one.accept()[0], servers[one]
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                if port == 30004:
                    clients[sock] = Client(sock)
                else:
                    lines[sock] = port
                if port == 29999:
                    sock.sendall(b"Connected: Universal Robots Dashboard Server\n")
                continue
            try:
                chunk = one.recv(65536)
            except OSError:
                chunk = b""
            if not chunk:
                one.close()
                clients.pop(one, None)
                lines.pop(one, None)
            elif one in lines and lines[one] == 29999:
                for line in chunk.decode().splitlines():
                    one.sendall(
                        DASHBOARD.get(line, f"could not understand: {line}").encode() + b"\n"
                    )
            elif one in lines:
                if b"\nend" in chunk:
                    controller.values.update({"runtime_state": PLAYING, "input_int_register_0": 0})
            else:
                client = clients[one]
                client.pending += chunk
                while len(client.pending) >= 3:
                    size = int.from_bytes(client.pending[:2], "big")
                    if len(client.pending) < size:
                        break
                    package, client.pending = client.pending[:size], client.pending[size:]
                    controller.take(client, chr(package[2]), package[3:])
        if time.monotonic() >= due:
            due += TICK
            controller.tick(time.monotonic())
            for client in clients.values():
                client.count += 1
                if client.is_started and client.count % client.every == 0:
                    try:
                        client.send("U", controller.package(client.outputs))
                    except OSError:
                        client.is_started = False


@contextmanager
def reading(host, file, pose, joints):
    """Run the controller in a process of its own; its poses are in *file* afterwards."""
    process = subprocess.Popen(
        [sys.executable, __file__, host, str(file), *map(repr, (*pose, *joints))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout.readline() == b"ready\n"
        yield
    finally:
        process.stdin.close()
        process.wait(10.0)
        process.stdout.close()


def read_poses(file):
    """Return the poses that arrived."""
    return list(struct.iter_unpack("=6d", file.read_bytes()))


if __name__ == "__main__":
    host, file, *numbers = sys.argv[1:]
    numbers = list(map(float, numbers))
    controller = Controller(numbers[:6], numbers[6:])
    print("ready", flush=True)
    serve(host, controller, sys.stdin)
    Path(file).write_bytes(b"".join(struct.pack("=6d", *pose) for pose in controller.poses))
