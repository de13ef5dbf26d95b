"""Identity of a client, from the kernel or a certificate, and the tables of roles."""

import os
import socket
import time

import pytest

from orientd.config import AccessSettings, Role
from orientd.daemon.access.identity import ClientCertificate, Process, RolePolicy, peer_process
from orientd.errors import ConfigError

LATER = time.time() + 3600.0


def policy(revoked=(), **tables):
    return RolePolicy(AccessSettings.model_validate(tables), revoked)


def role(found):
    return None if found is None else found.role


def test_without_tables_there_are_root_and_the_daemons_own_user():
    found = policy()
    for uid in (0, os.geteuid()):
        assert role(found.identify(Process(1, uid, (uid,)))) is Role.ADMINISTRATOR
    assert found.identify(Process(1, 54321, (54321,))) is None
    assert not found.admits_others


def test_root_is_admitted_by_the_daemon_of_another_user(monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    assert role(policy().identify(Process(1, 0, (0,)))) is Role.ADMINISTRATOR


def test_the_highest_role_counts():
    found = policy(users={"54321": "observer"}, groups={"500": "operator", "501": "observer"})
    assert found.admits_others
    assert role(found.identify(Process(1, 54321, (9,)))) is Role.OBSERVER
    assert role(found.identify(Process(1, 54321, (9, 500)))) is Role.OPERATOR
    assert role(found.identify(Process(1, 54322, (501, 500)))) is Role.OPERATOR


def test_no_table_takes_the_daemons_own_user_a_role():
    found = policy(users={str(os.geteuid()): "observer", "0": "observer"})
    assert role(found.identify(Process(1, os.geteuid(), ()))) is Role.ADMINISTRATOR


def test_names_of_users_and_groups_are_looked_up():
    found = policy(users={"root": "observer"}, groups={"root": "operator"})
    assert role(found.identify(Process(1, 54321, (0,)))) is Role.OPERATOR
    with pytest.raises(ConfigError, match="no user 'nobody-at-all'"):
        policy(users={"nobody-at-all": "operator"})
    with pytest.raises(ConfigError, match="no group 'none-at-all'"):
        policy(groups={"none-at-all": "operator"})


def test_a_certificate_counts_until_it_expires_or_is_revoked():
    found = policy(["AB12"], certificates={"pendant": "operator"})
    assert role(found.identify(ClientCertificate("pendant", "AB13", LATER))) is Role.OPERATOR
    assert found.identify(ClientCertificate("pendant", "AB12", LATER)) is None
    assert found.identify(ClientCertificate("pendant", "AB13", time.time() - 1.0)) is None
    assert found.identify(ClientCertificate("other", "AB13", LATER)) is None


def test_certificates_and_users_of_one_name_are_two():
    found = policy(users={"0": "operator"}, certificates={"0": "operator"})
    keys = {
        found.identify(ClientCertificate("0", "1", LATER)).key,
        found.identify(Process(1, 0, ())).key,
    }
    assert keys == {"user:0", "certificate:0"}


def test_the_kernel_says_who_connected():
    left, right = socket.socketpair(socket.AF_UNIX)
    with left, right:
        process = peer_process(left)
    assert (process.pid, process.uid) == (os.getpid(), os.geteuid())
    assert set(process.gids) == {os.getegid(), *os.getgroups()}
