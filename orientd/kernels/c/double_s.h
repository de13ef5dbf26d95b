/* Motion along a line at the limits of velocity, acceleration and jerk, in closed form: the double S
 * (Biagiotti and Melchiorri 2008, section 3.4), and its second half, which is the quickest stop.
 *
 * A stop in whole cycles changes the velocity by c, c - d, c - 2d ..., where d is what the jerk
 * allows.  Between samples this chain equals an integrator with constant jerk, for the shifted
 * quantities v - h a / 2 and e + h v - h^2 a / 6 (h: the period, e: the remaining way).  With them the
 * formulas of continuous time are exact at any rate.
 */
#ifndef ORIENTD_DOUBLE_S_H
#define ORIENTD_DOUBLE_S_H

#include <math.h>

#include "arrays.h"

/* Write the durations of the quickest motion from rest to rest, s: of rising and of constant
 * acceleration, each of them twice and mirrored, and of constant velocity.
 *
 * The limits of velocity and jerk may be infinite. */
INLINE void double_s(double way, double velocity, double acceleration, double jerk, double t[3]) {
    double rise = acceleration / jerk, hold = 0.0, cruise = 0.0, peak;
    /* First ignore the velocity limit. */
    if (way < 2.0 * acceleration * rise * rise) {
        rise = cbrt(0.5 * way / jerk);
        peak = jerk * rise * rise;
    } else {
        hold = fmax(0.5 * (sqrt(rise * rise + 4.0 * way / acceleration) - 3.0 * rise), 0.0);
        peak = acceleration * (rise + hold);
    }
    if (peak > velocity) {
        if (velocity < jerk * rise * rise)
            rise = sqrt(velocity / jerk), hold = 0.0;
        else
            hold = fmax(velocity / acceleration - rise, 0.0);
        cruise = fmax(way / velocity - (2.0 * rise + hold), 0.0);
    }
    t[0] = rise, t[1] = hold, t[2] = cruise;
}

/* A stop: how long it takes, s, and its way, signed. */
typedef struct { double time, way; } line_stop_t;

/* The quickest stop from a speed of either sign and its rate.  The limit of the jerk may be infinite. */
INLINE line_stop_t stop_along(double speed, double rate, double acceleration, double jerk) {
    double sign = speed + 0.5 * rate * fabs(rate) / jerk < 0.0 ? -1.0 : 1.0;
    speed *= sign, rate *= sign;
    double square = larger(jerk * speed + 0.5 * rate * rate, 0.0);
    double peak = smaller(sqrt(square), acceleration), fall = (rate + peak) / jerk, rise = peak / jerk;
    double time = fall + rise;
    double way = fall * (speed + fall * (rate / 3.0 - peak / 6.0)) + peak * rise * rise / 6.0;
    if (peak == acceleration) {
        /* Speeds as the constant acceleration begins and ends. */
        double first = speed + 0.5 * (rate * rate - peak * peak) / jerk, last = 0.5 * peak * rise;
        time += (first - last) / peak;
        way += 0.5 * (first * first - last * last) / peak;
    }
    return (line_stop_t){time, sign * way};
}

/* The speed from which, without initial acceleration, a stop fits within a way. */
INLINE double closing_speed(double way, double acceleration, double jerk) {
    double ramp = acceleration * acceleration / jerk;
    if (way * jerk <= acceleration * ramp)
        return cbrt(way * way * jerk);
    return sqrt(0.25 * ramp * ramp + 2.0 * acceleration * way) - 0.5 * ramp;
}

/* The first of the changes c, c - d, c - 2d ... of the next cycles, by which a velocity changes by a
 * total without overshoot.  They sum up to (n + 1)(c - d n / 2), n = floor(c / d).
 *
 * total: not negative.
 * step: d, the largest difference of changes in two cycles, by the jerk. */
INLINE double first_change(double total, double step) {
    double left = total / step, whole = floor(0.5 * (sqrt(1.0 + 8.0 * left) - 1.0));
    return (left / (whole + 1.0) + 0.5 * whole) * step;
}

#endif
