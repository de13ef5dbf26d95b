"""What the certificate of a gimbal says of its route."""

from types import SimpleNamespace

from orientd.mechanism import gimbal_route


def test_a_path_that_is_not_missed_is_no_deviation():
    path = SimpleNamespace(period=0.002, path_times=None)
    route = SimpleNamespace(error=(1e-9, 1.0), slews=(), passages=(), path=path)
    assert gimbal_route._deviations(route) == []
    route.error = (0.1, 1.0)
    (line,) = gimbal_route._deviations(route)
    assert line == "the path is missed by at most 5.7296 deg at 1.000 s"
