"""Connectors from one state of motion to another: lead-ins, lead-outs, retargets and blends.

Other packages import from ``axis_leads``, ``connector``, ``leads`` and ``position_stop``.
"""
