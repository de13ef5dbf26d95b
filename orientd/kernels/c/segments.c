/* What is known of the path between the records of a block, and how far rotations commute there.
 *
 * Time is counted in periods.  The law is r(u), so the angular velocity in the body is J_r(r) r',
 * the angular acceleration its derivative, and the jerk the derivative of that,
 *
 *     j = r''' - (r x r''' + r' x r'') / 2 + (r x (r x r'))'' / 6 - ...,
 *
 * which is r''' - c1 x c2 at the record and turns with the body from there on.
 *
 * The rotation vector x(t) from the setpoint a time s <= 1 before t to that at t is the integral of
 * the angular velocity and F, what does not commute.  With the angular velocities w and v at both
 * ends, x' = w - v + N exactly, where
 *
 *     N = x x (w + v) / 2 + g x x (x x (w - v)),   g = 1/12 + |x|^2 / 720 + ...
 *
 * In the first product x differs from (w + v) / 2 by the error e of the trapezoidal rule only, and
 * e' is the same error of the acceleration.  So F, N and N' are bounded by products of velocity,
 * acceleration and jerk that are small of higher order; this is where certified differences come
 * from.  First differences of setpoints are then averages of the velocity but for F, second ones
 * averages of the acceleration but for a difference of F's, which N bounds, and third ones averages
 * of the jerk but for a second difference of F's, which N' bounds.
 *
 * Three numbers that are not a turn commute: F, N and N' are zero, and every bound holds for each of
 * them by itself.
 */
#include <string.h>

#include "differences.h"

/* J_r(r) r'' and what the change of J_r adds: the angular acceleration. */
INLINE vec_t acceleration(vec_t r, vec_t rate, vec_t bend) {
    double square = dot(r, r), change = 2.0 * dot(r, rate);
    double a = 0.5 - square * (1.0 / 24 - square * (1.0 / 720));
    double b = 1.0 / 6 - square * (1.0 / 120 - square * (1.0 / 5040));
    double a_change = change * (-1.0 / 24 + square * (1.0 / 360));
    double b_change = change * (-1.0 / 120 + square * (1.0 / 2520));
    vec_t turn = cross(r, rate), push = cross(r, bend);
    vec_t found = plus(minus(bend, times(a, push)), times(b, cross(r, push)));
    found = plus(minus(found, times(a_change, turn)), times(b_change, cross(r, turn)));
    return plus(found, times(b, cross(rate, turn)));
}

INLINE void put_laws_of(const block_t *block, bool is_turn, double period, const lanes_t *turns,
                        segments_t *restrict to) {
    const double (*rows)[BLOCK] = block->rows;
    double square = period * period;
    INDEPENDENT
    for (index_t i = 0; i < block->count - 1; i++) {
        vec_t v = times(period, vec(rows[4][i], rows[5][i], rows[6][i]));
        vec_t w = times(period, vec(rows[4][i + 1], rows[5][i + 1], rows[6][i + 1]));
        vec_t a = times(square, vec(rows[7][i], rows[8][i], rows[9][i]));
        vec_t b = times(square, vec(rows[7][i + 1], rows[8][i + 1], rows[9][i + 1]));
        law_t law = is_turn ? law_between(at(turns, i), v, w, a, b) : hermite(at(turns, i), v, w);
        put(&to->first, i, law.first), put(&to->second, i, law.second);
        put(&to->third, i, law.third), put(&to->step, i, law.step);
        to->place[i] = law.place;
        put(&to->leave, i, v), put(&to->arrive, i, w);
    }
}

void put_laws(const block_t *block, double period, const lanes_t *turns, segments_t *restrict to) {
    if (block->turns)
        put_laws_of(block, true, period, turns, to);
    else
        put_laws_of(block, false, period, turns, to);
}

/* Write what is known of each law by itself. */
INLINE void put_alone(index_t count, bool is_turn, const lanes_t *turns, segments_t *restrict to) {
    double turning = is_turn ? 1.0 : 0.0;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        vec_t v = at(&to->leave, i), w = at(&to->arrive, i), step = at(&to->step, i);
        vec_t second = times(2.0, at(&to->second, i)), third = times(6.0, at(&to->third, i));
        double over = 1.0 - to->place[i];
        vec_t before = plus(second, times(to->place[i], third));
        vec_t behind = plus(before, step), last = plus(plus(second, third), step);
        vec_t rate = plus(plus(at(&to->first, i), second), plus(times(0.5, third),
                                                                times(over, step)));
        double w1 = larger(norm(v), norm(w)), j1 = norm(third), d = norm(step);
        double most = larger(larger(norm(second), norm(before)), larger(norm(behind), norm(last)));
        /* Between its ends the velocity is at most this much larger. */
        double w2 = w1 + 0.125 * j1 + 0.25 * d, a2 = most + turning * 0.3 * w2 * w2 * most;
        put(&to->begin, i, second), put(&to->before, i, before), put(&to->behind, i, behind);
        put(&to->end, i, is_turn ? acceleration(at(turns, i), rate, last) : last);
        vec_t jerk = minus(third, times(0.5 * turning, cross(v, second)));
        vec_t spin = times(turning, cross(third, v));
        double spread = 0.6 * w2 * d + w2 * w2 * (0.7 * a2 + 0.2 * j1) + 0.5 * a2 * j1;
        spread *= turning;
        put(&to->jerk, i, jerk), put(&to->spin, i, spin);
        to->speed[i] = w2, to->bend[i] = a2, to->steps[i] = d, to->spread[i] = spread;
        to->twist[i] = larger(norm(jerk), norm(plus(jerk, spin))) + spread;
        to->turning[i] = turning * w2;
    }
    INDEPENDENT
    for (index_t i = 0; i + 1 < count; i++) {
        double w = to->turning[i];
        vec_t jump = minus(at(&to->begin, i + 1), at(&to->end, i));
        put(&to->jump, i, jump);
        to->loose[i] = 0.01 * w * w * w * w * to->bend[i];
        to->jumped[i] = norm(jump) + to->loose[i];
    }
    put(&to->jump, count - 1, vec(0, 0, 0));
    to->loose[count - 1] = to->jumped[count - 1] = 0.0;
}

void put_segments(index_t count, bool is_turn, const lanes_t *turns, segments_t *restrict to) {
    if (!is_turn) {
        put_alone(count, false, turns, to);
        for (int row = 0; row < 3; row++)
            memset(to->coupling[row], 0, sizeof to->coupling[row]);
        memset(to->slope, 0, sizeof to->slope), memset(to->rest, 0, sizeof to->rest);
        return;
    }
    put_alone(count, true, turns, to);
    INDEPENDENT
    for (index_t i = 0; i < count - 1; i++) {
        double w = larger(to->speed[i], to->speed[i + 1]);
        double a = larger(to->bend[i], to->bend[i + 1]);
        double j = larger(to->twist[i], to->twist[i + 1]);
        double d = to->steps[i] + to->steps[i + 1] + jump_of(to, i, 0);
        double change = norm(minus(at(&to->jerk, i + 1), at(&to->jerk, i)))
                      + 2.0 * larger(norm(at(&to->spin, i)) + to->spread[i],
                                     norm(at(&to->spin, i + 1)) + to->spread[i + 1]);
        double f = 0.1 * a * w, e = j / 12 + 0.125 * d + f, n = w * e + 0.085 * w * w * a;
        to->coupling[0][i] = f, to->coupling[1][i] = n;
        to->coupling[2][i] = w * (0.125 * change + 0.5 * d + n) + a * e
                        + 0.09 * (w * a * (a + 2.0 * n) + w * w * (j + d));
        to->slope[i] = w * (0.5 * a + f) * (0.5 + 0.085 * w);
        to->rest[i] = 0.175 * to->coupling[2][i] + 0.002 * (w * w * j + a * j + w * a * a);
    }
}
