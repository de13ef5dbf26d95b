/* The path between two records: the one law that the servo runs and the certificate examines.
 *
 *     q(u) = q_a exp(r(u)),  r(u) = c1 u + c2 u^2 + c3 u^3 + d max(u - f, 0)^2 / 2,  u in [0, 1],
 *
 * where r'(0) = h omega_a, r'(1) = J_r(r(1))^-1 h omega_b and r(1) = log(q_a^-1 q_b).  The file
 * orientd/servo/path/segment.py has the same law with the same order of operations, and derives
 * the step d of the acceleration and its place f.
 */
#ifndef ORIENTD_BETWEEN_H
#define ORIENTD_BETWEEN_H

#include "lanes.h"
#include "rotation.h"

/* Least step of the acceleration that is looked for, rad in a period squared. */
#define LEAST_STEP 2e-7

/* A step of the acceleration this close to a record, in periods, is at the record.  So rounding
 * does not decide which of two places explains the records. */
#define AT_RECORD 1e-6

/* The rotation vector from a record on, rad in powers of the share of a period. */
typedef struct { vec_t first, second, third, step; double place; } law_t;

/* A step of the acceleration that lies a share of the period before the second record, and by how
 * much it fails to explain the records, squared; infinite where it lies elsewhere. */
typedef struct { vec_t step; double after, gap; } bend_t;

INLINE bend_t bend_at(double after, vec_t s, vec_t t, vec_t rise) {
    double m = after - 0.5, n = after * after - 1.0 / 3, scale = 1.0 / (m * m + n * n);
    vec_t step = plus(times(m * scale, s), times(n * scale, t)), rest = minus(rise, step);
    double gap = dot(rest, rest);
    gap = after >= -AT_RECORD ? gap : INFINITY;
    gap = after <= 1.0 + AT_RECORD ? gap : INFINITY;
    after = after > 0.0 ? after : 0.0;
    return (bend_t){step, after < 1.0 ? after : 1.0, gap};
}

/* Return the step of the acceleration between two records, or 0 if it is continuous. */
INLINE bend_t find_bend(vec_t turn, vec_t v, vec_t w, vec_t a, vec_t rise) {
    vec_t s = minus(minus(minus(w, v), a), times(0.5, rise));
    vec_t t = minus(minus(times(2.0, minus(turn, v)), a), times(1.0 / 3, rise));
    t = minus(t, times(1.0 / 6, cross(v, w)));
    double ss = dot(s, s), tt = dot(t, t), st = dot(s, t);
    double over = ss > tt ? st : tt, under = ss > tt ? ss : st;
    double root = sqrt((over - under) * (over - under) + under * under * (1.0 / 3));
    /* The roots of under w^2 - over w + over / 2 - under / 3, in the form that does not cancel. */
    double sum = 0.5 * (over + copysign(root, over));
    bend_t one = bend_at(sum / under, s, t, rise);
    bend_t other = bend_at((0.5 * over - 1.0 / 3 * under) / sum, s, t, rise);
    double least_gap = one.gap <= other.gap ? one.gap : other.gap;
    double most_step = ss > tt ? ss : tt;
    double is_there = most_step >= LEAST_STEP * LEAST_STEP ? 1.0 : 0.0;
    is_there = least_gap < INFINITY ? is_there : 0.0;
    bool is_one = one.gap <= other.gap;
    double after = is_one ? one.after : other.after, x = is_one ? one.step.x : other.step.x;
    double y = is_one ? one.step.y : other.step.y, z = is_one ? one.step.z : other.step.z;
    return (bend_t){vec(is_there > 0.0 ? x : 0.0, is_there > 0.0 ? y : 0.0,
                        is_there > 0.0 ? z : 0.0), is_there > 0.0 ? after : 0.0, 0.0};
}

/* J_r(r)^-1 v, the series to twice the tenth order, which is for turns below half a turn. */
INLINE vec_t right_jacobian_inverse(vec_t r, vec_t v) {
    double square = dot(r, r);
    double factor = 1.0 / 12 + square * (1.0 / 720 + square * (1.0 / 30240
                  + square * (1.0 / 1209600 + square * (1.0 / 47900160))));
    vec_t turn = cross(r, v);
    return plus(plus(v, times(0.5, turn)), times(factor, cross(r, turn)));
}

/* J_r(r) v, with sine and cosine of half the angle, the sine over the angle. */
INLINE vec_t right_jacobian(vec_t r, double c, double s, vec_t v) {
    double square = dot(r, r);
    double near = 1.0 / 6 + square * (-1.0 / 120 + square * (1.0 / 5040
                + square * (-1.0 / 362880 + square * (1.0 / 39916800))));
    double far = square > 0.0 ? (1.0 - 2.0 * s * c) / square : 0.0;
    double b = square < SEAM * SEAM ? near : far;
    vec_t turn = cross(r, v);
    return plus(minus(v, times(2.0 * s * s, turn)), times(b, cross(r, turn)));
}

/* The law of the cubic that comes to a vector with given derivatives at its ends. */
INLINE law_t hermite(vec_t way, vec_t leave, vec_t arrive) {
    vec_t second = minus(minus(times(3.0, way), times(2.0, leave)), arrive);
    return (law_t){leave, second, minus(plus(leave, arrive), times(2.0, way)), {0, 0, 0}, 1.0};
}

/* The law between two records.
 *
 * turn: rotation vector from one to the other.
 * v, w: angular velocities times the period.
 * a, b: angular accelerations times its square. */
INLINE law_t law_between(vec_t turn, vec_t v, vec_t w, vec_t a, vec_t b) {
    law_t law = hermite(turn, v, right_jacobian_inverse(turn, w));
    bend_t bend = find_bend(turn, v, w, a, minus(b, a));
    double after = bend.after;
    law.second = plus(law.second, times(after * (1.0 - 1.5 * after), bend.step));
    law.third = plus(law.third, times(after * (after - 1.0), bend.step));
    law.step = bend.step, law.place = 1.0 - after;
    return law;
}

/* u (a + u (b + u c)) + over^2 / 2 d */
INLINE vec_t law_value(law_t law, double u) {
    double over = u - law.place, bend;
    over = over > 0.0 ? over : 0.0;
    bend = 0.5 * over * over;
    vec_t cubic = plus(law.first, times(u, plus(law.second, times(u, law.third))));
    return plus(times(u, cubic), times(bend, law.step));
}

INLINE vec_t law_rate(law_t law, double u) {
    double over = u - law.place;
    over = over > 0.0 ? over : 0.0;
    vec_t cubic = plus(plus(law.first, times(2.0 * u, law.second)), times(3.0 * u * u, law.third));
    return plus(cubic, times(over, law.step));
}

/* An orientation followed by a rotation vector, and sine and cosine of half of its angle, the sine
 * over the angle. */
INLINE quat_t turned_by(quat_t q, vec_t turn, double *c, double *s) {
    double angle = norm(turn), sine;
    cosine_and_sine(0.5 * angle, c, &sine);
    *s = angle > 0.0 ? sine / angle : 0.5;
    return followed(q, *c, times(*s, turn));
}

/* between.c */

/* Write states between records.
 *
 * here: records, orientation and angular velocity, and then angular acceleration, position and
 *     velocity, and acceleration of the position, as far as they are known, shape (n, 7), (n, 10),
 *     (n, 16) or (n, 19).
 * there: the records after them.
 * periods: from each to the next, s, shape (n,).
 * shares: of these periods, in [0, 1], shape (n,).
 * out: receives the states, of the same columns. */
void between(matrix_t here, matrix_t there, row_t periods, row_t shares, matrix_t out);

#endif
