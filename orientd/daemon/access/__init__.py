"""Control access: peer credentials, roles, authorization, and the audit log."""

from __future__ import annotations

from orientd.daemon.access.audit import AuditLog, audit_path
from orientd.daemon.access.authorization import Authorization, Method, keyframe_count
from orientd.daemon.access.claim import claimed
from orientd.daemon.access.identity import (
    Caller,
    ClientCertificate,
    Identity,
    Process,
    RolePolicy,
    peer_process,
)
from orientd.daemon.access.listener import Listener, Tables
