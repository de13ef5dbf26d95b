/* Certify motions: hold what a device sees of setpoints against its limits, setpoints that come as
 * rows or from a path.  What the kernels of this group offer. */
#ifndef ORIENTD_CERTIFY_H
#define ORIENTD_CERTIFY_H

#include "arrays.h"

/* Setpoints before the first that a third difference reaches back to. */
enum { HISTORY = 3 };

/* The numbers of the row that a path is sampled from are not a path. */
enum { NO_PATH = -3 };

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
 * unproven: receives the number of periods in which the path turns too far for a proof. */
int certify(matrix_t rows, index_t past, measure_t how, extremes_t found, slowest_t *slowest,
            index_t *unproven);

/* path.c */

/* Write orientations, and velocities and accelerations where there is room for them.
 *
 * path: the row of numbers of orientd.planner.path.plain_path.
 * times: increasing path times, s, shape (n,).
 * out: receives samples, shape (4, n) or (10, n). */
int sample_path(row_t path, row_t times, matrix_t out);

/* Write the largest angle between orientations and a path, rad.
 *
 * times: increasing path times, s, shape (n,).
 * keys: orientations that the path should have then, shape (n, 4). */
int farthest_from_path(row_t path, row_t times, matrix_t keys, double *angle);

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

/* What is looked at: a curve at a constant rate, from its beginning.
 *
 * curve: the row of numbers of a curve, see orientd.planner.path.plain_path.
 * rate: curve seconds for a second.
 * duration: how long it takes, s.
 * period: of the device, s.
 * is_held: whether the device holds before the first record, and after the last one. */
typedef struct { row_t curve; double rate, duration, period; bool is_held[2]; } look_t;

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
