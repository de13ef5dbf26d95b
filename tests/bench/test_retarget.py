"""A retarget on its way from the call to the first setpoint that it changes."""

import pytest
from retarget_parts import PARTS, measure_retargets

pytestmark = pytest.mark.bench

PERIOD = 0.002


@pytest.mark.timeout(300)
def test_a_retarget_waits_no_longer_than_its_planning_takes():
    for found in measure_retargets((1, 20), count=200, rate_hz=1.0 / PERIOD):
        figures = ", ".join(
            f"{name} {1e3 * found.parts[name].p50:.2f} / {1e3 * found.parts[name].p99:.2f}"
            for name in PARTS
        )
        print(
            f"\n{found.keyframes} keyframes, {found.retargets} retargets, {found.replanned} "
            f"replanned; p50 / p99 in ms: {figures}"
        )
        part = {name: found.parts[name].p50 for name in PARTS}
        # The point of departure lies far enough ahead for what planning may take, and is rounded
        # up to whole records.
        work = part["planning"] + part["splicing"]
        assert part["waiting"] <= work + 3 * PERIOD
        assert part["rpc"] < work
        assert found.replanned <= 0.2 * found.retargets
