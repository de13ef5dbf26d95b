"""The command line.

Packages with commands of their own use ``command`` (options to connect and to plan),
``following`` (a motion until it has ended), ``parameters``, ``installed`` (groups of commands),
``interrupts``, ``output`` and ``texts`` (values in words).  Commands that record, show a page or
start daemons also use ``commands.record``, ``commands.view`` and ``own_daemon``.  They name each
command in the group ``orientd.commands`` of their entry points.
"""
