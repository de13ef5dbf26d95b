"""How gRPC's channels are to behave, at the client's end and at the daemon's."""

from __future__ import annotations

from orientd.rpc.address import MAX_MESSAGE_BYTES

_BOTH_ENDS = (
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
    ("grpc.keepalive_time_ms", 10_000),
    ("grpc.keepalive_timeout_ms", 5_000),
)

CLIENT_OPTIONS = (
    *_BOTH_ENDS,
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    # A daemon that is back is heard at once: by new clients in a process whose old ones still try,
    # and by those soon, where gRPC would wait for up to two minutes.
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.max_reconnect_backoff_ms", 500),
)


def server_options(message_bytes: int) -> tuple[tuple[str, int], ...]:
    """Return the options of a daemon that takes messages of at most *message_bytes*."""
    return (
        *_BOTH_ENDS,
        ("grpc.max_receive_message_length", message_bytes),
        ("grpc.http2.min_recv_ping_interval_without_data_ms", 5_000),
        ("grpc.so_reuseport", 0),
    )
