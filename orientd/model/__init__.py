"""The model of a motion request, the same for a motion file, Python and a message.

Other packages import from ``cones``, ``fields``, ``keyframes``, ``limits``, ``orientation``,
``plain``, ``reading``, ``refusal``, ``request`` and ``schema``.
"""
