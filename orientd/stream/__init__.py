"""The data that the daemon and a servo process exchange over shared memory.

Other packages import from ``memory``, ``records`` and ``ring``.
"""

from orientd.stream.records import Cycle, CycleFlag, ServoState
