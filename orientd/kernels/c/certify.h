/* Certify motions: hold what a device sees of setpoints against its limits, setpoints that come as
 * rows or from a trajectory.  What the kernels of this group offer. */
#ifndef ORIENTD_CERTIFY_H
#define ORIENTD_CERTIFY_H

#include "arrays.h"

/* Setpoints before the first that a third difference reaches back to. */
enum { HISTORY = 3 };

/* Bounds of the backward differences, and the largest at the records: squares, in units of rad a
 * period, and where they are about.  Rows are velocity, acceleration and jerk, then those on the
 * records alone; columns the norm and the three components, shape (6, 4).  Places are of the first
 * three rows, shape (12,). */
typedef struct { double *squares; int64_t *places; } extremes_t;

/* What the brake rate follows from; orientd.planner.certify.brake has the mathematics.
 *
 * nodes: rates to look at, and how fast the rate may change there, shape (2, n).
 * worst: share of the acceleration over the speed that is allowed at roots of the reserve from 0
 *     to 1, shape (m,).
 * most_change: the largest 3 sigma g.
 * fastest: the largest rate to return, 1/s.
 * margin: to keep, a share. */
typedef struct { matrix_t nodes; row_t worst; double most_change, fastest, margin; } brake_law_t;

/* How differences are taken and held against limits.
 *
 * with_axes: whether the largest components are wanted, too.
 * is_certificate: whether the brake rate is, and bounds that are proven; else differences are taken
 *     at the phases alone.
 * period: from one setpoint to the next, s.
 * most: limits of acceleration and jerk, of the norm and the components, shape (2, 4). */
typedef struct {
    bool with_axes, is_certificate;
    double period;
    const double *most;
    brake_law_t law;
} measure_t;

/* The least brake rate, 1/s, and which third difference sets it. */
typedef struct { double rate; index_t place; } slowest_t;

/* brake.c */

/* Return the least rate over points of a path.
 *
 * velocity, acceleration: of the path, shape (n, k).
 * jerk: size of the jerk, shape (n,).
 * most, most_jerk: limits; infinite where there is none. */
int least_rate(matrix_t velocity, matrix_t acceleration, row_t jerk, double most, double most_jerk,
               brake_law_t law, slowest_t *found);

/* certificate.c */

/* Write bounds of the backward differences of setpoints, and return the least brake rate.
 *
 * The rate and the differences that it follows from are those of the records and of three phases
 * between them.
 *
 * rows: orientations of records, shape (4, n); with angular velocities and accelerations, shape
 *     (10, n), the path between them counts, too.
 * past: how many accelerations, and twice as many velocities, are not to count as largest.
 * found: bounds of records before these, or zeros, where the bounds of both go.
 * unproven: receives the number of periods in which the path turns too far for a proof, or where
 *     none was found soon. */
int certify(matrix_t rows, index_t past, measure_t how, extremes_t found, slowest_t *slowest,
            index_t *unproven);


#endif
