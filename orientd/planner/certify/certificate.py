"""The certificate of a motion: what it was checked for before anything of it is sent."""

from __future__ import annotations

from dataclasses import dataclass

from orientd.mechanism import Figure


@dataclass(frozen=True, slots=True)
class Peak:
    """A bound of a quantity.

    Attributes:
        value: a bound of it, in SI units: proven for every phase of the setpoints against the
            records and every rate in [0, 1], as :mod:`orientd.planner.certify.measuring` says.
        time: path time of the record where it is about as large, s.
        limit: what was allowed.
        on_records: the largest of a motion that runs as planned, where that is less: off its
            records, after a pause, a stop or another speed, it may be somewhat more.
    """

    value: float
    time: float
    limit: float
    on_records: float | None = None

    @property
    def ratio(self) -> float:
        """The value as a share of the limit."""
        return self.value / self.limit

    @property
    def planned_ratio(self) -> float:
        """The same of what runs as planned."""
        return self.ratio if self.on_records is None else self.on_records / self.limit


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a motion was checked for; what has none is not streamed.

    Attributes:
        rate_hz: the device's cycles a second, at which all this holds.
        duration: from hold to hold, s.
        lead_in: the part of it before the first keyframe, s.
        lead_out: the part of it after the last keyframe, s.
        peak_velocity: angular, rad/s.
        peak_acceleration: angular, rad/s^2.
        peak_jerk: angular, rad/s^3.
        peak_linear_velocity: m/s.
        peak_linear_acceleration: m/s^2.
        start_velocity_error: between the velocity asked for at the first keyframe and the
            motion's, rad/s; zero where none was asked for.
        end_velocity_error: the same at the last keyframe, rad/s.
        keyframe_error: largest angle between a keyframe and the motion at its time, rad; not small
            where they are control points.
        brake_rate: how fast the servo may change speed on the path, 1/s.
        stop_time: how long a stop on the path from full speed takes at the most: until the device
            rests, or until the motion ends by itself, s.
        usual_stop_time: how long it usually takes from the place where it takes longest, about, s:
            the servo brakes as hard as the limits permit wherever it finds a way to.
        figures: what is certified beyond that: of the body's axes where they have limits of
            their own, and what the device's driver adds, of its own axes for example.
        notes: what there is to say of the motion and of how it was asked for, a line each.
        has_control_points: whether the keyframes are control points, which the method does not
            pass.
    """

    rate_hz: float
    duration: float
    lead_in: float
    lead_out: float
    peak_velocity: Peak
    peak_acceleration: Peak
    peak_jerk: Peak
    peak_linear_velocity: Peak
    peak_linear_acceleration: Peak
    start_velocity_error: float
    end_velocity_error: float
    keyframe_error: float
    brake_rate: float
    stop_time: float
    usual_stop_time: float
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()
    has_control_points: bool = False
