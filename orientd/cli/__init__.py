"""The command line.

Packages with commands of their own use ``command`` (options to connect and to plan),
``parameters``, ``installed`` (groups of commands) and ``output``.  They name each command in the
group ``orientd.commands`` of their entry points.
"""
