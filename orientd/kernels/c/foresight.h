/* Foresee a stop of a device that follows targets, and what it demands of the axes. */
#ifndef ORIENTD_FORESIGHT_H
#define ORIENTD_FORESIGHT_H

#include "arrays.h"

/* A setpoint, and a stop from it.  The stop of the orientation takes a first cycle, and then turns
 * about one axis; its acceleration falls, stays, and rises to zero.  The stop of the position is
 * straight, with constant deceleration.
 *
 * period: of a cycle, s.
 * q, position: the setpoint; m.
 * velocity: of the step to it, m/s.
 * acceleration: of the stop of the position, m/s^2.
 * braked: orientation after the first cycle of the stop.
 * axis, speed, rate: of the turn after it, in rad/s and rad/s^2.
 * phases: durations of falling, constant and rising acceleration, s; all zero without a turn.
 * jerk: rad/s^3. */
typedef struct {
    double period, q[4], position[3], velocity[3], acceleration;
    double braked[4], axis[3], speed, rate, phases[3], jerk;
} coming_stop_t;

enum { COMING_STOP = sizeof(coming_stop_t) / sizeof(double) };

/* Write the setpoint, the first cycle of the stop, and later poses of it, and return how many.
 *
 * seconds: receives the time of each after the one before it, shape (n,), n > 2.
 * poses: receives orientation and position, shape (n, 7). */
index_t foresee_stop(const coming_stop_t *stop, row_t seconds, matrix_t poses);

/* Limits of an axis that a stop would exceed. */
enum { TOO_FAST, TOO_SUDDEN, AT_ITS_END };
/* The place of the axis, which of the three, the value, and its limit. */
enum { STRAIN = 4 };

/* Return the first row of joints to which an axis cannot go, or how many there are.
 *
 * seconds, joints: as foreseen; the first two rows are the setpoint and the first cycle of a stop.
 * last: the joints at the last setpoint, rad, and the rates of the step to it, rad/s; shape (2, m).
 * axes: least and largest angle, velocity and acceleration of each; shape (m, 4).
 * period: of a cycle, s.
 * strain: receives what the axis cannot do. */
index_t first_strain(row_t seconds, matrix_t joints, matrix_t last, matrix_t axes, double period,
                     row_t strain);

#endif
