"""Antenna programs: the protocol of Hamlib's rotctld, and passes of satellites.

For others: the function ``satellite_pass``, the motion request of a whole pass.
"""

from orientd_rotctld.satellite_pass import satellite_pass
