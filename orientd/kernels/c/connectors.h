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
 * A curve of several joins end to end is one cumulative product like others: sample_product of
 * sampling.h serves what put_joins has written.
 */
#ifndef ORIENTD_CONNECTORS_H
#define ORIENTD_CONNECTORS_H

#include "lanes.h"
#include "rotation.h"

enum { FACTORS = 5 };  /* of a join */

/* The functions b_i and their first two derivatives by u. */
typedef struct { double value[FACTORS], rate[FACTORS], curvature[FACTORS]; } basis_t;

/* What a join is sampled from; a factor that does not turn has any axis. */
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

/* A motion followed by one factor of a join. */
INLINE motion_t past_factor(motion_t before, vec_t axis, double angle, double rate, double bend) {
    double c, s;
    cosine_and_sine(angle, &c, &s);
    vec_t e = times(s, axis);
    motion_t after = {
        followed(before.q, c, e),
        turned_back(c, e, before.omega),
        turned_back(c, e, before.alpha),
    };
    join(&after.omega, &after.alpha, axis, 2.0 * rate, 2.0 * bend);
    return after;
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

#endif
