"""The background service: devices, leases and plans, and the gRPC server in front of them."""
