"""Connectors from one state of motion to another: lead-ins, lead-outs, retargets and blends."""

from __future__ import annotations

from orientd.planner.connect.connector import turn_to_stop
from orientd.planner.connect.curve_connector import join_in
from orientd.planner.connect.lead_ins import (
    CONNECTIONS,
    USUAL,
    WITHOUT_RESERVE,
    Connection,
    LeadIn,
    lead_in,
)
from orientd.planner.connect.leads import approach, lead_out
from orientd.planner.connect.position_stop import position_lead
from orientd.planner.connect.quintic_connector import join, try_joins
from orientd.planner.connect.stops_at_keyframes import STOPS, stops_take, turns_with_stops
