"""Connectors from one state of motion to another: lead-ins, lead-outs, retargets and blends."""

from __future__ import annotations

from orientd.planner.connect.connector import (
    connector_lasting,
    hold,
    join,
    join_in,
    sample_joins,
    try_joins,
    turn_to_stop,
)
from orientd.planner.connect.leads import (
    CONNECTIONS,
    SAME_PLACE,
    USUAL,
    WITHOUT_RESERVE,
    Connection,
    LeadIn,
    approach,
    lead_in,
    lead_out,
)
from orientd.planner.connect.position_stop import position_lead
