"""The generated code is that of the .proto, and runs with the oldest libraries admitted."""

import re
import tomllib
from pathlib import Path

import pytest
from google.protobuf import descriptor_pb2

from orientd.protocol import control_pb2
from orientd.stream.records import ServoState

ROOT = Path(__file__).parents[3]
PROTO = "orientd/protocol/control.proto"


def lower_bound(name):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (bound,) = (
        match[1]
        for requirement in project["dependencies"]
        if (match := re.match(rf"{re.escape(name)}>=([0-9.]+)", requirement))
    )
    return tuple(map(int, bound.split(".")))


def test_generated_code_says_what_the_proto_says(tmp_path):
    protoc = pytest.importorskip("grpc_tools.protoc")
    path = tmp_path / "set"
    includes = Path(protoc.__file__).parent / "_proto"
    arguments = [f"-I{ROOT}", f"-I{includes}", f"--descriptor_set_out={path}", PROTO]
    assert protoc.main(["protoc", *arguments]) == 0
    (fresh,) = descriptor_pb2.FileDescriptorSet.FromString(path.read_bytes()).file
    committed = descriptor_pb2.FileDescriptorProto()
    control_pb2.DESCRIPTOR.CopyToProto(committed)
    # The compiler says what a JSON name would be; the generated code leaves that out.
    nested = [entry for message in fresh.message_type for entry in message.nested_type]
    for message in [*fresh.message_type, *nested]:
        for field in message.field:
            field.ClearField("json_name")
    assert committed == fresh


def test_messages_run_with_the_oldest_protobuf_admitted():
    text = (ROOT / "orientd/protocol/control_pb2.py").read_text()
    version = re.search(r"^# Protobuf Python Version: ([0-9.]+)$", text, re.MULTILINE)[1]
    assert tuple(map(int, version.split("."))) <= lower_bound("protobuf")


def test_every_number_of_the_proto_says_its_unit_or_is_a_count():
    """Floating-point fields have a comment of their own, or share the one of the field above."""
    lines = (ROOT / PROTO).read_text().splitlines()
    plain = {"Vector3", "Quaternion"}  # whose fields' units are said where they are used
    message = ""
    silent = []
    is_explained = False
    for line in map(str.strip, lines):
        if line.startswith("message "):
            message = line.split()[1]
        if line.startswith("//"):
            is_explained = True
        elif re.match(r"(optional |repeated )?double ", line):
            if not is_explained and message not in plain:
                silent.append(f"{message}: {line}")
        elif not line or line.startswith(("message", "}")):
            is_explained = False
    assert silent == []


def test_states_of_cycles_have_the_numbers_of_the_protocol():
    told = {f"STATE_{state.name}": state.value for state in ServoState}
    assert {"STATE_UNSPECIFIED": 0, **told} == dict(control_pb2.State.items())
