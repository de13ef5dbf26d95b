/* The shortest time along a trajectory from rest to rest, or between velocities that are given.
 *
 * The squared path velocity is found on a mesh (profile.h), first on a wide one and then on ever
 * narrower ones where the acceleration changes quickly.  Its path coordinate x is path time but for
 * the way from and to rest, see clock.h.
 */
#ifndef ORIENTD_TIMING_H
#define ORIENTD_TIMING_H

#include "arrays.h"

/* Rows of a profile on a mesh of n elements, each n + 2 numbers long:
 *
 * COEFFICIENTS: of the quadratic B-splines, n + 2 of them.
 * SHARES: the largest utilisation of velocity, acceleration and jerk in each element, n each.
 * AIMS: what the limits of each element are divided by, n each.
 * PLACES, VALUES, SLOPES, TIMES: path coordinate, squared path velocity, its slope and time at the
 *     nodes, n + 1 each. */
enum {
    COEFFICIENTS, SHARES, AIMS = SHARES + 3, PLACES = AIMS + 3, VALUES, SLOPES, TIMES,
    PROFILE_ROWS,
};

/* Numbers of a part: its elements, two lengths over which it leaves rest and comes to it (clock.h),
 * whether it moves at its beginning and its end, and the path times of both. */
enum { PART_NUMBERS = 7 };

/* A trajectory to time, and its limits.
 *
 * breaks, pieces: the trajectory by path time from 0 on, see trajectory.h.
 * knots: path times at which a derivative may have a step, both ends included.
 * edges: knots between which there are parts, both ends included, shape (p + 1,).
 * is_at_rest: whether every part begins and ends at rest where the path moves there.  If false, the
 *     path keeps the velocities and accelerations of its ends, and there is one part.
 * move_breaks, moves: the position, quintics by the time since each begins, at rest outside, shape
 *     (m + 1,) and (m, 18): three components of each of six coefficients; or (0,) and (0, 18).
 * limits: of velocity, acceleration and jerk, norm and components, shape (3, 4).
 * move_limits: of the position's velocity and acceleration, shape (2,).
 * period: of the device, s.
 * axis_breaks, axis_pieces: the angles of a mechanism's axes by path time, quintics by the time since
 *     each begins, shape (m + 1,) and (m, 6 axes): the angles' coefficients power by power; or (0,)
 *     and (0, 0) for no axes.
 * axis_limits: of their velocity, acceleration and jerk, shape (3, axes). */
typedef struct {
    row_t breaks;
    matrix_t pieces;
    row_t knots, edges;
    bool is_at_rest;
    row_t move_breaks;
    matrix_t moves, limits;
    row_t move_limits;
    double period;
    row_t axis_breaks;
    matrix_t axis_pieces, axis_limits;
} timing_t;

/* Profiles of the parts one after the other, row by row; to be freed. */
typedef struct { matrix_t rows; double *parts; } timed_t;

enum { TIMED = 1, NO_WAY = 0, STANDS_STILL = -1 };

/* Find the profiles of all parts.
 *
 * Return TIMED, NO_WAY where the limits leave none, STANDS_STILL where the squared rate falls to zero
 * on the way, or OUT_OF_MEMORY. */
int time_quickest(const timing_t *asked, timed_t *timed);

#endif
