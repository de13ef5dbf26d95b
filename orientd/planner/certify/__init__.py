"""Check records against limits as a device differentiates them, and issue a certificate.

Other packages import from ``brake``, ``certificate``, ``joints``, ``measuring`` and ``summary``.
"""
