"""Record events: the journal, the flight recorder, their lines in the log.

Other packages import from ``flight_recorder`` and ``journal``.
"""
