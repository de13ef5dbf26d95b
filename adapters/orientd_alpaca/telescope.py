"""Alpaca's telescope: an alt-azimuth mount that slews, moves its axes, tracks and parks."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable

from orientd_alpaca import device as alpaca
from orientd_alpaca.device import AlpacaDevice, AlpacaError, check_range
from orientd_alpaca.mount import Mount, Path
from orientd_serving.pointing import Direction, Equatorial, Place

_ALT_AZ, _TOPOCENTRIC, _SIDEREAL = 0, 1, 0
"""Numbers of ASCOM for the alignment, the coordinates and the rate of tracking."""

_ABLE = """canpark cansetpark cansettracking canslew canslewasync canslewaltaz canslewaltazasync
    canunpark"""
_UNABLE = """athome canfindhome canpulseguide cansetdeclinationrate cansetguiderates cansetpierside
    cansetrightascensionrate cansync cansyncaltaz doesrefraction ispulseguiding"""
_LACKS = """aperturearea aperturediameter declinationrate destinationsideofpier doesrefraction
    findhome focallength guideratedeclination guideraterightascension pulseguide rightascensionrate
    sideofpier slewsettletime synctoaltaz synctocoordinates synctotarget utcdate"""
_STATE = """Altitude AtHome AtPark Azimuth Declination IsPulseGuiding RightAscension SiderealTime
    Slewing Tracking UTCDate"""

_WAIT = 300.0
"""Longest duration of a slew that the client waits for, s."""


class Telescope(AlpacaDevice):
    """An alt-azimuth telescope."""

    kind = "Telescope"

    def __init__(self, mount: Mount, *, place: Place, park: Direction) -> None:
        """Serve *mount*.

        Args:
            mount: the device.
            place: where it stands, for right ascension and declination.
            park: where to park.
        """
        self._mount, self._place, self._park = mount, place, park
        self._is_parked = self._is_parking = self._is_tracking = self._is_slewing = False
        self._rates = [0.0, 0.0]
        self._sought = [math.nan, math.nan]
        gets = {
            **dict.fromkeys(_ABLE.split(), True),
            **dict.fromkeys(_UNABLE.split(), False),
            "alignmentmode": _ALT_AZ,
            "altitude": lambda: mount.measured()[0].elevation,
            "azimuth": lambda: mount.measured()[0].azimuth,
            "atpark": self._at_park,
            "axisrates": self._axis_rates,
            "canmoveaxis": self._can_move_axis,
            "declination": lambda: self._equatorial().declination,
            "declinationrate": 0.0,
            "equatorialsystem": _TOPOCENTRIC,
            "rightascension": lambda: self._equatorial().right_ascension,
            "rightascensionrate": 0.0,
            "siderealtime": lambda: self._place.sidereal_time(time.time()),
            "siteelevation": lambda: self._place.elevation,
            "sitelatitude": lambda: self._place.latitude,
            "sitelongitude": lambda: self._place.longitude,
            "slewing": self._look,
            "slewsettletime": 0,
            "targetdeclination": lambda: self._target(1),
            "targetrightascension": lambda: self._target(0),
            "tracking": self._tracks,
            "trackingrate": _SIDEREAL,
            "trackingrates": [_SIDEREAL],
            "utcdate": alpaca.stamp,
        }
        puts = {
            "abortslew": self._abort,
            "moveaxis": self._move_axis,
            "park": self._go_to_park,
            "setpark": self._set_park,
            "unpark": self._unpark,
            "siteelevation": self._set_elevation,
            "sitelatitude": self._set_latitude,
            "sitelongitude": self._set_longitude,
            "slewtoaltaz": self._waiting(self._slew),
            "slewtoaltazasync": self._slew,
            "slewtocoordinates": self._waiting(self._slew_to_sky),
            "slewtocoordinatesasync": self._slew_to_sky,
            "slewtotarget": self._waiting(self._slew_to_target),
            "slewtotargetasync": self._slew_to_target,
            "targetdeclination": self._seek_declination,
            "targetrightascension": self._seek_right_ascension,
            "tracking": self._track,
            "trackingrate": _check_rate,
        }
        super().__init__(mount.served, gets=gets, puts=puts, lacks=_LACKS, state=_STATE)

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
            raise AlpacaError(alpaca.PARKED, "the telescope is parked; unpark it first")
        self._is_parking = False

    # Slews

    def _slew(self, azimuth: float, altitude: float) -> None:
        check_range("Azimuth", azimuth, 0.0, 360.0)
        check_range("Altitude", altitude, -90.0, 90.0)
        self._free()
        if self._tracks():
            raise AlpacaError(alpaca.INVALID_OPERATION, "switch Tracking off first")
        self._go(Direction(azimuth, altitude))

    def _slew_to_sky(self, right_ascension: float, declination: float) -> None:
        target = Equatorial(right_ascension, declination)
        check_range("RightAscension", right_ascension, 0.0, 24.0)
        check_range("Declination", declination, -90.0, 90.0)
        self._free()
        if not self._tracks():
            raise AlpacaError(alpaca.INVALID_OPERATION, "switch Tracking on first")
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

        @functools.wraps(slew)
        def call(*to: float) -> None:
            slew(*to)
            end = time.monotonic() + _WAIT
            while self._look():
                if time.monotonic() > end:
                    raise AlpacaError(alpaca.DRIVER, f"the slew takes more than {_WAIT:g} s")
                time.sleep(0.05)

        return call

    def _slew_to_target(self) -> None:
        self._slew_to_sky(self._target(0), self._target(1))

    def _target(self, place: int) -> float:
        if math.isnan(self._sought[place]):
            raise AlpacaError(alpaca.VALUE_NOT_SET, "the target is not set")
        return self._sought[place]

    def _seek_right_ascension(self, target_right_ascension: float) -> None:
        check_range("TargetRightAscension", target_right_ascension, 0.0, 24.0)
        self._sought[0] = target_right_ascension

    def _seek_declination(self, target_declination: float) -> None:
        check_range("TargetDeclination", target_declination, -90.0, 90.0)
        self._sought[1] = target_declination

    def _abort(self) -> None:
        self._free()
        self._rates, self._is_slewing = [0.0, 0.0], False
        self._mount.stop()
        if self._is_tracking:
            self._track(True)

    # Tracking and axes

    def _track(self, tracking: bool) -> None:
        if tracking:
            self._free()
        with self._mount.lock:
            self._is_tracking = tracking
            if tracking:
                commanded = self._mount.commanded()[0]
                self._follow(self._place.equatorial(commanded, time.time()))
            elif not any(self._rates):
                self._mount.unfollow()

    def _can_move_axis(self, axis: int) -> bool:
        check_range("Axis", axis, 0, 2)
        return axis < 2

    def _axis_rates(self, axis: int) -> list[dict[str, float]]:
        return [{"Minimum": 0.0, "Maximum": self._fastest()}] if self._can_move_axis(axis) else []

    def _fastest(self) -> float:
        """Return the largest rate of an axis, degrees/s, with a reserve to catch up."""
        return round(0.9 * math.degrees(self._mount.served.report().limits.velocity), 3)

    def _move_axis(self, axis: int, rate: float) -> None:
        if not self._can_move_axis(axis):
            raise AlpacaError(alpaca.INVALID_VALUE, f"axis {axis} cannot move by itself")
        self._free()
        check_range("Rate", abs(rate), 0.0, self._fastest())
        with self._mount.lock:
            rates = list(self._rates)
            rates[axis] = rate
            self._is_slewing = False
            start, begin = self._mount.commanded()[0], time.time()
            if any(rates):
                self._mount.follow(_turning(start, begin, *rates))
            elif self._is_tracking:
                self._follow(self._place.equatorial(start, begin))
            else:
                self._mount.unfollow()
            self._rates = rates

    # Parking and place

    def _go_to_park(self) -> None:
        if not self._at_park():
            self._is_tracking = False
            self._go(self._park)
            self._is_parking = True

    def _set_park(self) -> None:
        self._park = self._mount.measured()[0]

    def _unpark(self) -> None:
        self._is_parked = self._is_parking = False

    def _set_elevation(self, site_elevation: float) -> None:
        check_range("SiteElevation", site_elevation, -300.0, 10000.0)
        self._place = self._place._replace(elevation=site_elevation)

    def _set_latitude(self, site_latitude: float) -> None:
        check_range("SiteLatitude", site_latitude, -90.0, 90.0)
        self._place = self._place._replace(latitude=site_latitude)

    def _set_longitude(self, site_longitude: float) -> None:
        check_range("SiteLongitude", site_longitude, -180.0, 180.0)
        self._place = self._place._replace(longitude=site_longitude)


def _check_rate(tracking_rate: int) -> None:
    if tracking_rate != _SIDEREAL:
        expected = f"TrackingRate: expected 0, sidereal, got {tracking_rate}"
        raise AlpacaError(alpaca.INVALID_VALUE, expected)


def _turning(start: Direction, begin: float, around: float, up: float) -> Path:
    """Return the directions of axes that move at constant rates, degrees/s."""

    def at(now: float) -> Direction:
        elevation = start.elevation + up * (now - begin)
        return Direction(start.azimuth + around * (now - begin), min(max(elevation, -90.0), 90.0))

    return at
