"""Control access: peer credentials, roles, authorization, and the audit log.

Other packages import from ``audit``, ``authorization``, ``claim``, ``identity`` and ``listener``.
"""
