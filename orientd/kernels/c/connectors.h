/* Joins of two states of motion, and connectors: the shortest way found from one to the other.
 *
 * A join is the curve kks_quintic_hermite: the cumulative Bernstein product of degree 5 with
 * orientation, angular velocity and acceleration prescribed at both ends, an extension of the cubic
 * Hermite curve of Kim, Kim and Shin (1995), sec. 5.2, which they do not give:
 *
 *     q(u) = q_0 exp(w_1 b_1(u)) ... exp(w_5 b_5(u)),   b_i = B_{i,5} + ... + B_{5,5},
 *
 * with half-angle increments w_i and u from 0 to 1 over its duration.
 *
 * product_trajectory of trajectory.h makes a trajectory of several joins end to end.
 */
#ifndef ORIENTD_CONNECTORS_H
#define ORIENTD_CONNECTORS_H

#include "sampling.h"

enum { FACTORS = 5 };  /* of a join */

/* The functions b_i and their first two derivatives by u. */
typedef struct { double value[FACTORS], rate[FACTORS], curvature[FACTORS]; } basis_t;

/* Limits of a connector's velocity, acceleration and jerk: the norm, then the components.  A value
 * without a limit is infinite. */
typedef struct { double most[3][4]; } bounds_t;

/* Return the value that one of the four bounds limits: the norm or the size of a component. */
INLINE double size_of(vec_t v, int bound) {
    return bound == 0 ? norm(v) : fabs(bound == 1 ? v.x : bound == 2 ? v.y : v.z);
}

/* A join in the form that is sampled; the axis of a factor without rotation is arbitrary. */
typedef struct {
    vec_t axis[FACTORS];
    double length[FACTORS];
    double per_second;  /* one over the duration */
} join_t;

INLINE basis_t join_basis(double u) {
    double v = 1.0 - u, uu = u * u, vv = v * v;
    /* Bernstein polynomials of degree 4 and 3. */
    double four[5] = {vv * vv, 4.0 * u * vv * v, 6.0 * uu * vv, 4.0 * uu * u * v, uu * uu};
    double three[4] = {vv * v, 3.0 * u * vv, 3.0 * uu * v, uu * u};
    /* Those of degree 5, summed from the last. */
    double fifth = u * four[4], fourth = fifth + (u * four[3] + v * four[4]);
    double third = fourth + (u * four[2] + v * four[3]);
    double second = third + (u * four[1] + v * four[2]);
    double first = second + (u * four[0] + v * four[1]);
    return (basis_t){
        {first, second, third, fourth, fifth},
        {5.0 * four[0], 5.0 * four[1], 5.0 * four[2], 5.0 * four[3], 5.0 * four[4]},
        {-20.0 * three[0], 20.0 * (three[0] - three[1]), 20.0 * (three[1] - three[2]),
         20.0 * (three[2] - three[3]), 20.0 * three[3]},
    };
}

INLINE join_t join_of(const vec_t w[FACTORS], double duration) {
    join_t join;
    for (int k = 0; k < FACTORS; k++) {
        double length = norm(w[k]);
        join.length[k] = length;
        join.axis[k] = times(length > 0.0 ? 1.0 / length : 0.0, w[k]);
    }
    join.per_second = 1.0 / duration;
    return join;
}

/* A join at some point, from the orientation it begins at.  Neither branches nor calls, so that a
 * loop over points goes to the vector units. */
INLINE motion_t join_at(quat_t begin, const join_t *of, basis_t basis) {
    motion_t here = {begin, vec(0.0, 0.0, 0.0), vec(0.0, 0.0, 0.0)};
#define PAST(K) \
    here = past_factor(here, of->axis[K], of->length[K] * basis.value[K], \
                       of->length[K] * basis.rate[K] * of->per_second, \
                       of->length[K] * basis.curvature[K] * of->per_second * of->per_second)
    PAST(0);
    PAST(1);
    PAST(2);
    PAST(3);
    PAST(4);
#undef PAST
    return here;
}

/* A state as a row: orientation, angular velocity and angular acceleration, body components. */
enum { STATE = 10 };

INLINE motion_t state_at(const double *row) {
    return (motion_t){quat_at(row), vec_at(row + 4), vec_at(row + 7)};
}
INLINE void put_state(double *row, motion_t state) {
    put_quat(row, state.q), put_vec(row + 4, state.omega), put_vec(row + 7, state.alpha);
}

/* join.c */

/* Write the increments of a join but the middle one, and return the quaternion of that, the
 * shorter way round. */
quat_t put_outer_increments(const motion_t *first, const motion_t *last, double duration,
                            vec_t w[FACTORS]);
/* Write all increments of a join, the shorter way round. */
void put_increments(const motion_t *first, const motion_t *last, double duration,
                    vec_t w[FACTORS]);

/* join_bounds.c */

/* Return the limits, but never less than what a device has in either of two states. */
bounds_t bounds_of(const motion_t *start, const motion_t *end, matrix_t limits);

/* Write the increments of several joins, the shorter way round each, and which keep the limits.
 *
 * first, last: states that they begin and end with, shape (n, 10).
 * durations: s, shape (n,).
 * around: a state whose velocity and acceleration are allowed whatever the limits, shape (10,).
 * limits: of velocity, acceleration and jerk, norm and components, shape (3, 4).
 * w: receives the increments, shape (n, 5, 3).
 * kept: receives 1 for each that keeps the limits and 0 for others, shape (n,). */
void try_joins(matrix_t first, matrix_t last, row_t durations, row_t around, matrix_t limits,
               tensor_t w, indices_t kept);

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

/* Write phases as a trajectory, and return how many pieces it has; nothing where there is no room for
 * them.
 *
 * breaks, pieces: receive the table, shapes (n + 1,) and (n, PIECE). */
index_t put_phases(const phases_t *phases, row_t breaks, matrix_t pieces);

/* Write the trajectory of a stop, and return how many pieces it has; 0 where it takes too long. */
index_t stop_from(row_t state, matrix_t limits, double period, double longest, row_t breaks,
                  matrix_t pieces);

#endif
