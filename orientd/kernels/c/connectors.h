/* Connectors: the shortest way found from one state of motion to another, and stops. */
#ifndef ORIENTD_CONNECTORS_H
#define ORIENTD_CONNECTORS_H

#include "sampling.h"

/* Limits of a connector's velocity, acceleration and jerk: the norm, then the components.  A value
 * without a limit is infinite. */
typedef struct { double most[3][4]; } bounds_t;

/* Return the value that one of the four bounds limits: the norm or the size of a component. */
INLINE double size_of(vec_t v, int bound) {
    return bound == 0 ? norm(v) : fabs(bound == 1 ? v.x : bound == 2 ? v.y : v.z);
}

/* A state as a row: orientation, angular velocity and angular acceleration, body components. */
enum { STATE = 10 };

INLINE motion_t state_at(const double *row) {
    return (motion_t){quat_at(row), vec_at(row + 4), vec_at(row + 7)};
}

/* stop.c */

/* States at the ends of phases of constant jerk, signs continuous, and their times, s. */
typedef struct { motion_t *node; double *time; index_t count, room; } phases_t;

enum { MOST_NODES = 16384 };

bool new_phases(motion_t state, phases_t *to);
void free_phases(phases_t *phases);

/* Return how many parts a phase has, each with a turn of at most *part*, rad. */
double parts_of(vec_t first, vec_t last, double duration, double part);

/* Add the state that a phase of constant jerk leads to, and those between its parts.
 *
 * omega, alpha: velocity and acceleration at its end.
 * bent_part: longest turn of a part whose axis changes, rad. */
bool add_parts(phases_t *to, vec_t omega, vec_t alpha, double duration, double bent_part);

/* Add the quickest stop from a state; false where it takes longer than longest, s.
 *
 * limits: of acceleration and jerk, shape (3, 4).
 * period: it takes a whole number of periods, s; 0 for as long as it needs. */
bool add_stop(const motion_t *state, matrix_t limits, double period, double longest, phases_t *to);

/* Add a stop, a turn and a run-up, from one state to another, in a whole number of periods.
 *
 * own: limits of the stop.
 * least, longest: that it may take, s. */
bool by_way_of_rest(const motion_t *start, const motion_t *end, matrix_t limits, matrix_t own,
                    double period, double least, double longest, phases_t *to);

/* Write phases as a trajectory, and return how many pieces it has; nothing if there is no room for
 * them.
 *
 * breaks, pieces: receive the table, shapes (n + 1,) and (n, PIECE). */
index_t put_phases(const phases_t *phases, row_t breaks, matrix_t pieces);

/* Write the trajectory of a stop, and return how many pieces it has; 0 where it takes too long. */
index_t stop_from(row_t state, matrix_t limits, double period, double longest, row_t breaks,
                  matrix_t pieces);

#endif
