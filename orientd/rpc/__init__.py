"""The control socket: protocol, conversions, errors on the wire, and the Python client."""
