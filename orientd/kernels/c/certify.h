/* Certify motions: compare the rates that a device sees with its limits.  The setpoints come as rows
 * or from a trajectory.  This header declares the functions of this group of kernels. */
#ifndef ORIENTD_CERTIFY_H
#define ORIENTD_CERTIFY_H

#include "arrays.h"

/* Setpoints before the first that a third difference reaches back to. */
enum { HISTORY = 3 };

/* Numbers of a state: orientation, angular velocity and acceleration, position and its velocity. */
enum { STATE_ROWS = 16, POSITION = 10, MOVING = 13 };

/* Most parts of a period, and the longest reach. */
enum { MOST_PARTS = 1000 };

/* That are looked at in one call: days of them. */
enum { MOST_SETPOINTS = 200000000 };

/* Setpoints a period apart: some before the path, records of it, and the last one held.
 *
 * breaks, pieces: the trajectory by path time from 0 on, see trajectory.h; or none, with records.
 * move_breaks, moves: the position, see moves.h; or none, and it stays at a place, shape (3,).
 * rows: the records, shape (n, STATE_ROWS); or none, with a trajectory.
 * before: setpoints before the first record, shape (h, STATE_ROWS); rates there may be unknown, not
 *     numbers.
 * first, count: the records that are looked at.
 * held: how many setpoints behind the last record the device stays there.
 * period: from one to the next, s.
 * step: the same in path time, s.
 * rests: whether the path is at rest at its beginning, and at its end: to the last digit then. */
typedef struct {
    row_t breaks;
    matrix_t pieces;
    row_t move_breaks;
    matrix_t moves;
    row_t place;
    matrix_t rows, before;
    index_t first, count, held;
    double period, step;
    bool rests[2];
} setpoints_t;

/* Bounds of the backward differences, and the largest at the records: squares, in units of rad a
 * period, and where they are about.  Rows are velocity, acceleration and jerk, then those on the
 * records alone; columns the norm and the three components.  Places are of the first three rows:
 * the record at which the difference ends. */
typedef struct {
    double squares[24], places[12];
    double moved[2], move_places[2];  /* bounds of the position's differences at the rate 1 */
    double rate, rate_place;          /* the least brake rate, 1/s, and the record that sets it */
    double stop_time;                 /* of the place from which a stop takes longest, s */
    double unproven;                  /* places without a proof */
    double moved_on_records[2];       /* the position's differences on the records alone */
} extremes_t;

enum { EXTREMES = sizeof(extremes_t) / sizeof(double) };

/* What the brake rate follows from; orientd.planner.certify.brake has the mathematics.
 *
 * nodes: rates to look at, and how fast the rate may change there, shape (2, n).
 * worst: share of the acceleration over the speed that is allowed at roots of the reserve from 0
 *     to 1, shape (m,).
 * most_change: the largest 3 sigma g.
 * fastest: the largest rate to return, 1/s.
 * margin: to keep, a share. */
typedef struct { matrix_t nodes; row_t worst; double most_change, fastest, margin; } brake_law_t;

/* What is looked for.
 *
 * limits: of velocity, acceleration and jerk, norm and components, shape (3, 4).
 * move_limits: of the position's velocity and acceleration, shape (2,).
 * tolerance: factor to the limits up to which a path may be braked; 0 for no certificate: then
 *     differences are taken at the phases alone, and nothing is said of stops. */
typedef struct {
    matrix_t limits;
    row_t move_limits;
    double tolerance;
    brake_law_t law;
} measure_t;

/* The least brake rate, 1/s, and which point sets it. */
typedef struct { double rate; index_t place; } slowest_t;

/* brake.c */

/* Return the least rate over points of a path.
 *
 * velocity, acceleration: of the path, shape (n, k).
 * jerk: size of the jerk, shape (n,).
 * most, most_jerk: limits; infinite if there is no limit. */
int least_rate(matrix_t velocity, matrix_t acceleration, row_t jerk, double most, double most_jerk,
               brake_law_t law, slowest_t *found);

/* turn_sizes.c */

/* Write the largest differences of setpoints' rotation vectors, period by period.
 *
 * q: orientations at even parts of a period, shape (n, 4).
 * order: 1 for the turn from a setpoint to the next, 2 for its difference from the turn before.
 * reach: from a setpoint to the next, in parts of a period.
 * parts: of a period.
 * out: the norm and the components' sizes, shape (m, 4); a difference counts in the period of its
 *     last setpoint.
 *
 * Return 0 or OUT_OF_MEMORY. */
int turn_sizes(matrix_t q, index_t order, index_t reach, index_t parts, matrix_t out);

/* certificate.c */

/* Hold setpoints against limits.  Return 0 or OUT_OF_MEMORY. */
int certify(const setpoints_t *from, const measure_t *how, extremes_t *found);

#endif
