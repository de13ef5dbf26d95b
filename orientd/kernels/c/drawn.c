/* What the servo draws between two records.
 *
 * A pause, a stop or another speed takes the device off the records, and what it is sent then lies
 * on the curve that orientd.servo.path.segment draws from the records around it.  With the angle P
 * from the first of them, in units of the period h,
 *
 *     q(u) = q_a exp(P(u)),  P'(0) = h omega_a,  P'(1) = J_r(r)^-1 h omega_b,  P(1) = r,
 *
 * a cubic: Kim, Kim and Shin's product of three factors differs from it by what does not commute
 * in an angle of a cycle, a thousandth of the fourth order of the period.  Where the acceleration
 * has a step between the records the cubic is bent, as orientd.servo.path.acceleration_step
 * derives.
 */
#include "differences.h"
#include "lanes.h"
#include "rotation.h"

/* What a step of the acceleration does to an angle from which on it is looked for, rad; that of
 * orientd.servo.path.acceleration_step. */
#define LEAST_STEP 2e-7

/* Rows of what is drawn: the coefficients of u, u^2 and u^3, the step of the acceleration in rad a
 * period squared, and the share of a period that it lies before the second record. */
enum { CURVE_ROWS = 13 };

/* A step of the acceleration, and by how much it fails to explain the records, squared; infinite
 * where it lies elsewhere. */
typedef struct { vec_t step; double after, gap; } bend_t;

/* The step that explains records if it lies a share of the period before the second one. */
INLINE bend_t bend_at(double after, vec_t s, vec_t t, vec_t rise) {
    double m = after - 0.5, n = after * after - 1.0 / 3, scale = 1.0 / (m * m + n * n);
    vec_t step = plus(times(m * scale, s), times(n * scale, t)), rest = minus(rise, step);
    double gap = dot(rest, rest);
    gap = after >= 0.0 ? gap : INFINITY;
    return (bend_t){step, after, after <= 1.0 ? gap : INFINITY};
}

/* Return the step of the acceleration between two records, 0 where there is none. */
INLINE bend_t find_bend(vec_t turn, vec_t v, vec_t w, vec_t a, vec_t b) {
    vec_t rise = minus(b, a);
    vec_t s = minus(minus(minus(w, v), a), times(0.5, rise));
    vec_t t = minus(minus(times(2.0, minus(turn, v)), a), times(1.0 / 3, rise));
    t = minus(t, times(1.0 / 6, cross(v, w)));
    double ss = dot(s, s), tt = dot(t, t), st = dot(s, t);
    double over = ss > tt ? st : tt, under = ss > tt ? ss : st;
    double root = sqrt((over - under) * (over - under) + under * under * (1.0 / 3));
    bool is_even = fabs(under) <= 1e-12 * fabs(over);
    double half = is_even ? 0.0 : 0.5 / under;
    bend_t one = bend_at(is_even ? 0.5 : half * (over + root), s, t, rise);
    bend_t other = bend_at(is_even ? 0.5 : half * (over - root), s, t, rise);
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
INLINE vec_t leaning_back(vec_t r, vec_t v) {
    double square = dot(r, r);
    double factor = 1.0 / 12 + square * (1.0 / 720 + square * (1.0 / 30240
                  + square * (1.0 / 1209600 + square * (1.0 / 47900160))));
    vec_t turn = cross(r, v);
    return plus(plus(v, times(0.5, turn)), times(factor, cross(r, turn)));
}

INLINE vec_t of_row(const double *restrict rows, index_t i, double scale) {
    return vec(scale * rows[i], scale * rows[BLOCK + i], scale * rows[2 * BLOCK + i]);
}

INLINE void to_row(double *restrict rows, index_t i, vec_t v) {
    rows[i] = v.x, rows[BLOCK + i] = v.y, rows[2 * BLOCK + i] = v.z;
}

static void put_curves(const double *restrict records, index_t count, double period,
                       const double *restrict turns, double *restrict curves) {
    const double *omega = records + 4 * BLOCK, *alpha = records + 7 * BLOCK;
    double square = period * period;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        vec_t r = of_row(turns, i, 1.0);
        vec_t v = of_row(omega, i, period), w = of_row(omega, i + 1, period);
        vec_t a = of_row(alpha, i, square), b = of_row(alpha, i + 1, square);
        vec_t arrive = leaning_back(r, w);
        to_row(curves, i, v);
        to_row(curves + 3 * BLOCK, i, minus(minus(times(3.0, r), times(2.0, v)), arrive));
        to_row(curves + 6 * BLOCK, i, minus(plus(v, arrive), times(2.0, r)));
        bend_t bend = find_bend(r, v, w, a, b);
        to_row(curves + 9 * BLOCK, i, bend.step);
        curves[12 * BLOCK + i] = bend.after;
    }
}

static void draw(const double *restrict records, index_t count, const double *restrict curves,
                 double u, double *restrict q) {
    double u2 = u * u, u3 = u2 * u;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        double w = curves[12 * BLOCK + i], over = u - 1.0 + w, c, s;
        over = over > 0.0 ? over : 0.0;
        double bend = 0.5 * over * over - u2 * w * (0.5 * w * (3.0 - 2.0 * u) - (1.0 - u));
        vec_t turn = plus(of_row(curves, i, u), of_row(curves + 3 * BLOCK, i, u2));
        turn = plus(turn, of_row(curves + 6 * BLOCK, i, u3));
        turn = plus(turn, of_row(curves + 9 * BLOCK, i, bend));
        double angle = norm(turn);
        cosine_and_sine(0.5 * angle, &c, &s);
        s = angle > 0.0 ? s / angle : 0.5;
        quat_t here = quat(records[i], records[BLOCK + i], records[2 * BLOCK + i],
                           records[3 * BLOCK + i]);
        here = followed(here, c, times(s, turn));
        q[i] = here.w, q[BLOCK + i] = here.x;
        q[2 * BLOCK + i] = here.y, q[3 * BLOCK + i] = here.z;
    }
}

void draw_between(const block_t *block, double period, const double *turns, seen_t *at) {
    double curves[CURVE_ROWS * BLOCK];
    index_t count = block->count - 1;
    put_curves(block->rows[0], count, period, turns, curves);
    for (int p = 1; p < PHASES; p++)
        draw(block->rows[0], count, curves, (double)p / PHASES, at[p].q[0]);
}
