"""Connectors from one state of motion to another: lead-ins, lead-outs, retargets and blends."""
