/* Certify motions: hold what a device sees of setpoints against its limits, setpoints that come as
 * rows or from a trajectory.  What the kernels of this group offer. */
#ifndef ORIENTD_CERTIFY_H
#define ORIENTD_CERTIFY_H

#include "arrays.h"

/* Setpoints before the first that a third difference reaches back to. */
enum { HISTORY = 3 };

/* The largest backward differences: squares, in units of rad a period, and where they are.  Rows
 * are velocity, acceleration and jerk, then those on the records alone; columns the norm and the three
 * components, shape (6, 4).  Places are of the first three rows, shape (12,). */
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
 * with_rate: whether the brake rate is.
 * period: from one setpoint to the next, s.
 * rough: path times from which and until which acceleration and jerk may be larger between the
 *     records, and how many times, shape (4,).
 * most: limits of acceleration and jerk, of the norm and the components, shape (2, 4). */
typedef struct {
    bool with_axes, with_rate;
    double period;
    const double *rough, *most;
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

/* Write the largest backward differences of setpoints, and return the least brake rate.
 *
 * q: orientations, shape (4, n); with angular velocities and accelerations, shape (10, n), what the
 *     servo draws between them counts, too.
 * past: how many accelerations, and twice as many velocities, are not to count as largest.
 * start: path time of the fourth setpoint, s.
 * found: zeros, where the differences go. */
int setpoint_extremes(matrix_t q, index_t past, double start, measure_t how, extremes_t found,
                      slowest_t *slowest);

/* survey.c */

/* Write instants on either side of every break of a curve and between them, and return how many.
 *
 * breaks: of the curve, increasing, from 0 on, s, shape (n,).
 * duration: of the motion, s; breaks beyond it are left out.
 * pieces: equal pieces that a curve of fewer breaks is cut into.
 * shares: where to look in each piece, increasing, shape (m,).
 * instants: receives them, shape (m (n + pieces + 1),) or more. */
index_t put_instants(row_t breaks, double duration, index_t pieces, row_t shares, row_t instants);

/* Write, instant by instant, by which factor a motion should take longer to keep its limits.
 *
 * instants: increasing, s, shape (n,).
 * omega, alpha: angular velocities and accelerations then, components first, shape (3, n).
 * period: of the device, s.
 * limits: of velocity, acceleration and jerk, of the norm and the components, shape (3, 4).
 * step: what the jerk of a step of the acceleration over a period is multiplied by; 0 if there is
 *     no such step, and jerks fall with the third power of the duration.
 * factors: receives them, shape (n,). */
void put_factors(row_t instants, matrix_t omega, matrix_t alpha, double period, matrix_t limits,
                 double step, row_t factors);

/* Write around which instants some factors are largest, as intervals in order, and return how many.
 *
 * instants, factors: shape (n,).
 * hot: the least factor that counts.
 * ends: intervals that count in any case, the first and the last one, shape (0 or 2, 2).
 * spots: receives them, shape (n + 2, 2) or more. */
index_t put_spots(row_t instants, row_t factors, double hot, matrix_t ends, matrix_t spots);

/* What is looked at: a trajectory from time 0 on.
 *
 * breaks, pieces: see trajectory.h.
 * period: of the device, s.
 * is_held: whether the device holds before the first record, and after the last one. */
typedef struct { row_t breaks; matrix_t pieces; double period; bool is_held[2]; } look_t;

/* Write by which factor a motion should take longer to keep its limits, from some records.
 *
 * ranges: first and last records of some parts, one part after the other, shape (2 n,).
 * limits: as in put_factors.
 * tolerance: factor by which what is drawn between the records may exceed them.
 * more: how much larger acceleration and jerk may be between the records.
 * is_smooth: whether jerks fall with the third power of the duration, or with the second. */
int look_at(indices_t ranges, look_t motion, matrix_t limits, double tolerance,
            const double more[2], bool is_smooth, double *factor);

#endif
