"""Plan motions: from a request to an immutable motion with its certificate.

Start with :func:`orientd.planner.planning.plan`.  A request checks itself when it is made.  The
:class:`~orientd.planner.certify.certificate.Certificate` of a motion has the properties that it
guarantees.

This package imports none of its modules: a daemon that has not planned yet stays small.

Other packages import from ``blending``, ``certify.certificate``, ``certifying``,
``device_planner``, ``facts``, ``methods``, ``motion``, ``offline``, ``path``, ``planning``,
``recorded``, ``resolve``, ``state`` and ``task``.
"""
