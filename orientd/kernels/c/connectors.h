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

enum {
    ROUGH = 17, ROUGH_LANES = 24,  /* points of a join that are looked at first */
    FINE = 49, FINE_LANES = 56,    /* points of one that seems to do; lanes repeat the last one */
};

/* Basis functions of the joins at evenly spaced points, the same for all joins. */
typedef struct {
    /* Velocity, acceleration and jerk of increments over a second, if turns commuted. */
    double rough[3][FACTORS][ROUGH_LANES];
    /* Basis functions with two derivatives. */
    double fine[3][FACTORS][FINE_LANES];
} points_t;

void put_points(points_t *points);

/* Return the limits, a little less of the velocity, but never less than what a device has in
 * either of two states. */
bounds_t bounds_of(const motion_t *start, const motion_t *end, matrix_t limits);
/* Whether a vector is above its bounds: the norm, or a component. */
bool exceeds(vec_t v, const double most[4]);
/* Whether a join keeps its bounds as if turns commuted. */
bool seems_to_keep(const vec_t w[FACTORS], double duration, const points_t *points,
                   const bounds_t *bounds);
/* Whether a join keeps its bounds at points of the curve itself. */
bool keeps(const vec_t w[FACTORS], double duration, const points_t *points,
           const bounds_t *bounds);

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

/* ramp.c */

enum { RAMPS = 6 };  /* at most, at either end of a connector */

/* Changes of the acceleration at one end, several to choose from; the first is none at all. */
typedef struct {
    motion_t ends[RAMPS];
    double durations[RAMPS];  /* s */
    int count;
} ramps_t;

/* Return the ramps that a connector may begin with.
 *
 * way: rotation vector to where it leads.
 * limits: with their reserve, shape (3, 4).
 * period: least duration, s.
 * in_cycles: whether durations are whole periods. */
ramps_t ramps_from(const motion_t *state, vec_t way, matrix_t limits, const bounds_t *bounds,
                   double period, bool in_cycles);

/* leave.c */

/* Write the joins of the shortest way found from a state to rest, wherever that is, and return how
 * many there are: one, or a ramp and one; 0 if there is none.
 *
 * state: shape (10,).
 * limits: of velocity, acceleration and jerk with their reserve, norm and components, shape (3, 4).
 * period: every join takes a whole number of periods, s.
 * longest: what takes longer is not looked for, s.
 * may_ramp: whether a ramp may come first.
 * q: receives the orientations that they begin at, shape (2, 4).
 * w: receives their increments, shape (2, 5, 3).
 * breaks: receives when they begin, and when the last one ends, s, shape (3,); if there are none, the
 *     second number is about how long one would take. */
index_t leave(row_t state, matrix_t limits, double period, double longest, bool may_ramp,
              matrix_t q, tensor_t w, row_t breaks);

/* connector_search.c */

/* Write the shortest connector that is found, a ramp, a join and another ramp, and return whether
 * there is one.
 *
 * start, end: states, shape (10,).
 * limits: of velocity, acceleration and jerk with their reserve, norm and components, shape (3, 4).
 * period: it takes a whole number of periods, s.
 * least: it takes at least this long, s.
 * most_turn: the integral of its angular velocity, body components, is no longer, rad.
 * q: receives the orientations that the three begin at, signs continuous, shape (3, 4).
 * w: receives the increments of the three, shape (3, 5, 3); of one that takes no time none.
 * times: receives when the three begin and when the last one ends, s, shape (4,). */
bool find_connector(row_t start, row_t end, matrix_t limits, double period, double least,
                    double most_turn, matrix_t q, tensor_t w, row_t times);

/* Write a join, the way round that turns less, that need not keep the limits, as find_connector does.
 *
 * rates: share of the velocities and accelerations of the states that it has at its ends.
 * duration: share of the middle one of those that find_connector looks at. */
void guess_connector(row_t start, row_t end, matrix_t limits, double period, double least,
                     double rates, double duration, matrix_t q, tensor_t w, row_t times);

#endif
