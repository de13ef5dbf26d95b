"""The Python client: connect to a daemon, and command and watch its devices.

Start with :func:`orientd.connect`.  This package imports none of its modules: a command that stops
a device loads little.

Other packages import from ``channel``, ``clutch``, ``connection``, ``daemon_clock``,
``endless_turn``, ``motion_text``, ``move_handle``, ``observer``, ``playing``, ``pointing``,
``robot``, ``smoothing``, ``stop_call``, ``target_messages``, ``teaching``, ``tracking`` and
``trust``.
"""
