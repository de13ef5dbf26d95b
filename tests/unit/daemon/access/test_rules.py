"""The table of roles has a row for every call, and says what is safe for what it does not have."""

from orientd.config import Role
from orientd.daemon.access.authorization import CONTROL, RULES, rule
from orientd.protocol import control_pb2 as pb

SERVICE = pb.DESCRIPTOR.services_by_name["Control"]


def test_every_call_has_a_row_and_every_row_a_call():
    assert SERVICE.full_name == CONTROL
    assert set(RULES) == {method.name for method in SERVICE.methods}


def test_what_needs_the_lease_needs_an_operator_and_is_recorded():
    for method in SERVICE.methods:
        fields = method.input_type.fields_by_name
        begin = fields["start"].message_type if method.name == "Track" else None
        if "lease_token" in fields or (begin and "lease_token" in begin.fields_by_name):
            assert RULES[method.name].role >= Role.OPERATOR, method.name
            assert RULES[method.name].is_command, method.name


def test_anybody_who_comes_in_may_stop_however_much_they_ask_for():
    for name in ("Stop", "Halt"):
        assert RULES[name].role is Role.OBSERVER
        assert not RULES[name].is_limited


def test_a_call_without_a_row_is_for_administrators():
    assert rule(f"/{CONTROL}/SelfDestruct").role is Role.ADMINISTRATOR
    assert rule("/grpc.health.v1.Health/Check").role is Role.OBSERVER
