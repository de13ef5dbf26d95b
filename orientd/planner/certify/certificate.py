"""The certificate of a motion: the checks that it passed before the servo sends any of it."""

from __future__ import annotations

from dataclasses import dataclass

from orientd.mechanism.figure import Figure, Loss


@dataclass(frozen=True, slots=True)
class Peak:
    """An upper bound of a quantity.

    Attributes:
        value: the bound, in SI units.  It is proven for every phase of the setpoints relative to
            the records and every rate in [0, 1]; see :mod:`orientd.planner.certify.measuring`.
        time: path time of the record where the quantity is about as large, s.
        limit: the allowed value.
        on_records: the largest value while the motion runs as planned, if that is smaller.  After a
            pause, a stop or a change of speed, setpoints lie between the records.
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
        """*on_records* as a share of the limit."""
        return self.ratio if self.on_records is None else self.on_records / self.limit


@dataclass(frozen=True, slots=True)
class Certificate:
    """The checks that a motion passed; a motion without a certificate is never sent.

    Attributes:
        rate_hz: the device's cycles per second, for which all values hold.
        duration: from start to finish, at rest, s.
        lead_in: the part before the first keyframe, s.
        lead_out: the part after the last keyframe, s.
        peak_velocity: angular, rad/s.
        peak_acceleration: angular, rad/s^2.
        peak_jerk: angular, rad/s^3.
        peak_linear_velocity: m/s.
        peak_linear_acceleration: m/s^2.
        start_velocity_error: between the requested velocity at the first keyframe and the
            motion's, rad/s; zero if none was requested.
        end_velocity_error: between the requested velocity at the last keyframe and the motion's,
            rad/s.
        keyframe_error: largest angle between a keyframe and the motion at its time, rad; not small
            for control points.
        brake_rate: how fast the servo may change the speed on the path, 1/s.
        stop_time: longest stop on the path from full speed, s: until the device rests, or until the
            motion ends by itself.
        usual_stop_time: typical duration of the longest stop, about, s.  The servo brakes as hard
            as the limits permit if it can.
        figures: further certified numbers, about body axes with their own limits and about the
            axes of the device.
        notes: remarks on the motion and on its request, one line each.
        has_control_points: whether the keyframes are control points, which the method does not
            pass.
        losses: when the axes of a gimbal do not point along the path, in order.
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
    losses: tuple[Loss, ...] = ()
