"""Who may do what: peer credentials, roles, authorization, and the audit log."""

from __future__ import annotations

from orientd.daemon.access.authentication import Admission, inner_socket
from orientd.daemon.access.claim import claimed
from orientd.daemon.access.gate import StartupGate
from orientd.daemon.access.identity import CALLER, ClientCertificate, Identity, RolePolicy
from orientd.daemon.access.peer import Process, peer_process
