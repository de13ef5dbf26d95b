"""Alpaca's telescope: an alt-azimuth mount that slews, moves its axes, tracks and parks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from datetime import UTC, datetime

from orientd.adapters import alpaca_protocol as protocol
from orientd.adapters.alpaca_device import AlpacaDevice, unavailable
from orientd.adapters.alpaca_mount import Mount, turning
from orientd.adapters.alpaca_protocol import (
    AlpacaError,
    Member,
    Members,
    boolean,
    check_range,
    number,
    whole,
)
from orientd.adapters.equatorial import Equatorial, Place
from orientd.adapters.pointing import Direction

_ALT_AZ, _TOPOCENTRIC, _SIDEREAL = 0, 1, 0
"""Numbers of ASCOM for the alignment, the coordinates and the rate of tracking."""

_WAIT = 300.0
"""Longest duration of a slew that the client waits for, s."""


class Telescope(AlpacaDevice):
    """An alt-azimuth telescope."""

    kind = "Telescope"
    state = ("Altitude", "AtHome", "AtPark", "Azimuth", "Declination", "IsPulseGuiding",
             "RightAscension", "SiderealTime", "Slewing", "Tracking", "UTCDate")  # fmt: skip

    def __init__(self, mount: Mount, *, place: Place, park: Direction) -> None:
        """Serve *mount*.

        Args:
            mount: the device.
            place: where it stands, for right ascension and declination.
            park: where to park.
        """
        self._place, self._park = place, park
        self._is_parked = self._is_parking = self._is_tracking = self._is_slewing = False
        self._rates = [0.0, 0.0]
        self._sought = [math.nan, math.nan]
        super().__init__(mount)

    def own_gets(self) -> Members:
        """Return the properties of a telescope."""
        able = ("canpark", "cansetpark", "cansettracking", "canslew", "canslewasync",
                "canslewaltaz", "canslewaltazasync", "canunpark")  # fmt: skip
        unable = ("athome", "canfindhome", "canpulseguide", "cansetdeclinationrate",
                  "cansetguiderates", "cansetpierside", "cansetrightascensionrate", "cansync",
                  "cansyncaltaz", "doesrefraction", "ispulseguiding")  # fmt: skip
        return {
            **{name: Member(lambda: True) for name in able},
            **{name: Member(lambda: False) for name in unable},
            "alignmentmode": Member(lambda: _ALT_AZ),
            "altitude": Member(lambda: self._mount.measured()[0].elevation),
            "azimuth": Member(lambda: self._mount.measured()[0].azimuth),
            "atpark": Member(self._at_park),
            "axisrates": Member(self._axis_rates, {"Axis": whole}),
            "canmoveaxis": Member(lambda axis: _axis(axis) < 2, {"Axis": whole}),
            "declination": Member(lambda: self._equatorial().declination),
            "declinationrate": Member(lambda: 0.0),
            "equatorialsystem": Member(lambda: _TOPOCENTRIC),
            "rightascension": Member(lambda: self._equatorial().right_ascension),
            "rightascensionrate": Member(lambda: 0.0),
            "siderealtime": Member(lambda: self._place.sidereal_time(time.time())),
            "siteelevation": Member(lambda: self._place.elevation),
            "sitelatitude": Member(lambda: self._place.latitude),
            "sitelongitude": Member(lambda: self._place.longitude),
            "slewing": Member(self._look),
            "slewsettletime": Member(lambda: 0),
            "targetdeclination": Member(lambda: self._target(1)),
            "targetrightascension": Member(lambda: self._target(0)),
            "tracking": Member(self._tracks),
            "trackingrate": Member(lambda: _SIDEREAL),
            "trackingrates": Member(lambda: [_SIDEREAL]),
            "utcdate": Member(lambda: datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")),
            **unavailable("aperturearea", "aperturediameter", "focallength", "guideratedeclination",
                          "guideraterightascension", "sideofpier"),
            **unavailable("destinationsideofpier", RightAscension=number, Declination=number),
        }  # fmt: skip

    def own_puts(self) -> Members:
        """Return the methods of a telescope."""
        sky = {"RightAscension": number, "Declination": number}
        horizon = {"Azimuth": number, "Altitude": number}
        height, north, east = (
            self._set_place(name, *limits)
            for name, *limits in (("elevation", -300, 10000), ("latitude", -90, 90),
                                  ("longitude", -180, 180))
        )  # fmt: skip
        return {
            "abortslew": Member(self._abort),
            "moveaxis": Member(self._move_axis, {"Axis": whole, "Rate": number}),
            "park": Member(self._go_to_park),
            "setpark": Member(self._set_park),
            "unpark": Member(self._unpark),
            "siteelevation": Member(height, {"SiteElevation": number}),
            "sitelatitude": Member(north, {"SiteLatitude": number}),
            "sitelongitude": Member(east, {"SiteLongitude": number}),
            "slewtoaltaz": Member(self._waiting(self._slew), horizon),
            "slewtoaltazasync": Member(self._slew, horizon),
            "slewtocoordinates": Member(self._waiting(self._slew_to_sky), sky),
            "slewtocoordinatesasync": Member(self._slew_to_sky, sky),
            "slewtotarget": Member(self._waiting(self._slew_to_target)),
            "slewtotargetasync": Member(self._slew_to_target),
            "targetdeclination": Member(self._seek_declination, {"TargetDeclination": number}),
            "targetrightascension": Member(
                self._seek_right_ascension, {"TargetRightAscension": number}
            ),
            "tracking": Member(self._track, {"Tracking": boolean}),
            "trackingrate": Member(_check_rate, {"TrackingRate": whole}),
            **unavailable("findhome"),
            **unavailable("synctotarget"),
            **unavailable("synctoaltaz", **horizon),
            **unavailable("synctocoordinates", **sky),
            **unavailable("pulseguide", Direction=whole, Duration=whole),
            **unavailable("declinationrate", DeclinationRate=number),
            **unavailable("rightascensionrate", RightAscensionRate=number),
            **unavailable("doesrefraction", DoesRefraction=boolean),
            **unavailable("guideratedeclination", GuideRateDeclination=number),
            **unavailable("guideraterightascension", GuideRateRightAscension=number),
            **unavailable("sideofpier", SideOfPier=whole),
            **unavailable("slewsettletime", SlewSettleTime=whole),
            **unavailable("utcdate", UTCDate=str),
        }  # fmt: skip

    # State

    def _equatorial(self) -> Equatorial:
        return self._place.equatorial(self._mount.measured()[0], time.time())

    def _look(self) -> bool:
        """Return whether it slews, or an axis moves."""
        self._is_slewing = self._is_slewing and self._mount.is_moving()
        return self._is_slewing or (any(self._rates) and not self._mount.problem)

    def _tracks(self) -> bool:
        return self._is_tracking and not self._mount.problem

    def _at_park(self) -> bool:
        if self._is_parking and not self._look():
            self._is_parking, self._is_parked = False, True
        return self._is_parked

    def _free(self) -> None:
        if self._at_park():
            raise AlpacaError(protocol.PARKED, "the telescope is parked; unpark it first")
        self._is_parking = False

    # Slews

    def _slew(self, azimuth: float, altitude: float) -> None:
        check_range("Azimuth", azimuth, 0.0, 360.0)
        check_range("Altitude", altitude, -90.0, 90.0)
        self._free()
        if self._tracks():
            raise AlpacaError(protocol.INVALID_OPERATION, "switch Tracking off first")
        self._go(Direction(azimuth, altitude))

    def _slew_to_sky(self, right_ascension: float, declination: float) -> None:
        target = Equatorial(right_ascension, declination)
        check_range("RightAscension", right_ascension, 0.0, 24.0)
        check_range("Declination", declination, -90.0, 90.0)
        self._free()
        if not self._tracks():
            raise AlpacaError(protocol.INVALID_OPERATION, "switch Tracking on first")
        self._sought = [*target]
        with self._mount.lock:
            self._go(self._place.direction(target, time.time()))
            self._follow(target)

    def _go(self, wanted: Direction) -> None:
        with self._mount.lock:
            self._rates = [0.0, 0.0]
            self._mount.go(wanted)
            self._is_slewing = True

    def _follow(self, target: Equatorial) -> None:
        self._mount.follow(lambda now: self._place.direction(target, now))

    def _waiting(self, slew: Callable[..., None]) -> Callable[..., None]:
        """Return a slew that returns at its end."""

        def call(*to: float) -> None:
            slew(*to)
            end = time.monotonic() + _WAIT
            while self._look():
                if time.monotonic() > end:
                    raise AlpacaError(protocol.DRIVER, f"the slew takes more than {_WAIT:g} s")
                time.sleep(0.05)

        return call

    def _slew_to_target(self) -> None:
        self._slew_to_sky(self._target(0), self._target(1))

    def _target(self, place: int) -> float:
        if math.isnan(self._sought[place]):
            raise AlpacaError(protocol.VALUE_NOT_SET, "the target is not set")
        return self._sought[place]

    def _seek_right_ascension(self, hours: float) -> None:
        check_range("TargetRightAscension", hours, 0.0, 24.0)
        self._sought[0] = hours

    def _seek_declination(self, angle: float) -> None:
        check_range("TargetDeclination", angle, -90.0, 90.0)
        self._sought[1] = angle

    def _abort(self) -> None:
        self._free()
        self._stop()
        if self._is_tracking:
            self._track(True)

    def _stop(self) -> None:
        self._rates, self._is_slewing, self._is_parking = [0.0, 0.0], False, False
        self._mount.stop()

    # Tracking and axes

    def _track(self, is_wanted: bool) -> None:
        if is_wanted:
            self._free()
        with self._mount.lock:
            self._is_tracking = is_wanted
            if is_wanted:
                commanded = self._mount.commanded()[0]
                self._follow(self._place.equatorial(commanded, time.time()))
            elif not any(self._rates):
                self._mount.unfollow()

    def _axis_rates(self, axis: int) -> list[dict[str, float]]:
        if _axis(axis) > 1:
            return []
        return [{"Minimum": 0.0, "Maximum": self._fastest()}]

    def _fastest(self) -> float:
        """Return the largest rate of an axis, degrees/s, with a reserve to catch up."""
        return round(0.9 * math.degrees(self._mount.served.report().limits.velocity), 3)

    def _move_axis(self, axis: int, rate: float) -> None:
        if _axis(axis) > 1:
            raise AlpacaError(protocol.INVALID_VALUE, f"axis {axis} cannot move by itself")
        self._free()
        check_range("Rate", abs(rate), 0.0, self._fastest())
        with self._mount.lock:
            rates = list(self._rates)
            rates[axis] = rate
            self._is_slewing = False
            start, begin = self._mount.commanded()[0], time.time()
            if any(rates):
                self._mount.follow(turning(start, begin, *rates))
            elif self._is_tracking:
                self._follow(self._place.equatorial(start, begin))
            else:
                self._mount.unfollow()
            self._rates = rates

    # Parking

    def _go_to_park(self) -> None:
        if self._at_park():
            return
        self._is_tracking = False
        self._go(self._park)
        self._is_parking = True

    def _set_park(self) -> None:
        self._park = self._mount.measured()[0]

    def _unpark(self) -> None:
        self._at_park()
        self._is_parked = self._is_parking = False

    def _set_place(self, name: str, low: float, high: float) -> Callable[[float], None]:
        def put(given: float) -> None:
            check_range(name, given, low, high)
            self._place = self._place._replace(**{name: given})

        return put


def _axis(axis: int) -> int:
    """Return the number of an axis.

    Raises:
        AlpacaError: there is no such axis.
    """
    check_range("Axis", axis, 0, 2)
    return axis


def _check_rate(rate: int) -> None:
    if rate != _SIDEREAL:
        raise AlpacaError(protocol.INVALID_VALUE, f"TrackingRate: expected 0, sidereal, got {rate}")
