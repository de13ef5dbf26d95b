"""The shared part of servers of one device, for programs of other systems.

For these servers: ``served`` (the device behind them), ``pointing`` and ``equatorial``
(directions), ``denials`` (warnings of wrong requests), and ``command`` (the group `orientd serve`
and the options of its commands).
"""
