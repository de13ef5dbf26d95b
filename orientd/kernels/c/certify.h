/* Certify motions: compare the rates that a device sees with its limits, one channel at a time.  A
 * channel is the turn of the tool, or up to three numbers that are not a turn: the tool's position,
 * or axes.  Its setpoints come as rows or from a trajectory.  This header declares the functions of
 * this group of kernels. */
#ifndef ORIENTD_CERTIFY_H
#define ORIENTD_CERTIFY_H

#include "arrays.h"

/* Setpoints before the first that a third difference reaches back to. */
enum { HISTORY = 3 };

/* Numbers of a setpoint: of a turn the orientation, angular velocity and acceleration, of other
 * channels three values and their velocities. */
enum { TURN_ROWS = 10, PLAIN_ROWS = 6 };

/* Numbers of a quintic of the position; see quintic.h. */
enum { MOVE = 18 };

/* That are looked at in one call: days of them. */
enum { MOST_SETPOINTS = 200000000 };

/* Setpoints of a channel, a period apart: some before the path, records of it, and the last one held.
 *
 * turns: whether it is a turn.
 * breaks, pieces: the trajectory by path time from 0 on, see trajectory.h, or the position, see
 *     moves.h; or none, with records.
 * rows: the records, shape (n, TURN_ROWS) or (n, PLAIN_ROWS); or none, with a trajectory.
 * before: setpoints before the first record, of the same columns; rates there may be unknown, not
 *     numbers.
 * first, count: the records that are looked at.
 * held: how many setpoints behind the last record the device stays there.
 * period: from one to the next, s.
 * step: the same in path time, s.
 * rests: whether the path is at rest at its beginning, and at its end: to the last digit then. */
typedef struct {
    bool turns;
    row_t breaks;
    matrix_t pieces, rows, before;
    index_t first, count, held;
    double period, step;
    bool rests[2];
} setpoints_t;

/* Bounds of the backward differences, and the largest at the records: squares, in units of the
 * channel a period, and where they are about.  Rows are velocity, acceleration and jerk, then those
 * on the records alone; columns the norm and the three components.  Places are of the first three
 * rows: the record at which the difference ends.  Slots of columns that do not count are 0. */
typedef struct {
    double squares[24], places[12];
    double rate, rate_place;          /* the least brake rate, 1/s, and the record that sets it */
    double stop_time;                 /* of the place from which a stop of a turn takes longest, s */
    double unproven;                  /* places without a proof */
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
 * limits: of velocity, acceleration and jerk, of which the last may be left out: norm and components,
 *     shape (orders, 4).
 * first, end: the columns that count: the norm is 0, the components are 1 to 3.
 * tolerance: factor to the limits up to which a path may be braked; 0 for no certificate: then
 *     differences are taken at the phases alone, and nothing is said of stops. */
typedef struct {
    matrix_t limits;
    int first, end;
    double tolerance;
    brake_law_t law;
} measure_t;

/* certificate.c */

/* Hold setpoints against limits.  Return 0 or OUT_OF_MEMORY. */
int certify(const setpoints_t *from, const measure_t *how, extremes_t *found);

#endif
