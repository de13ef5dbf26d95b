"""Recordings: what was planned, sent and measured, in MCAP files that viewers open.

Needs the extra ``record``: ``mcap`` and Foxglove's schemas, imported where a file
is read or written.
"""
