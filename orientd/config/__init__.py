"""The daemon's settings: one TOML file, every key checked, unknown keys refused.

.. code-block:: toml

    [daemon]
    lease_seconds = 5.0

    [devices.arm]
    driver = "loopback"
    rate_hz = 500

    [devices.arm.limits]
    velocity = 2.5

For packages with a table of their own: ``table`` and ``operation`` (values and their checks).
"""

from __future__ import annotations

from orientd.config.devices import FIRST_PHASE, SPIN_US, DeviceSettings, LimitSettings
from orientd.config.operation import AccessSettings, MetricsSettings, Role, TcpSettings
from orientd.config.settings import (
    Settings,
    default_settings,
    find,
    load,
    load_or_default,
    parse,
    parse_as,
    read_table,
)
from orientd.config.table import Table
from orientd.config.tls_files import TlsFileError, check_tls_files
