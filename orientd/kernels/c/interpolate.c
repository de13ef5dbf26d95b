/* The cumulative B-spline through keyframes, of orders 3 to 6 (Kim, Kim and Shin, 1995, sec. 5.3, made
 * to interpolate): knots, equations, and where the spans of the solution begin. */
#include <stdlib.h>
#include <string.h>

#include "increments.h"
#include "lane_log.h"
#include "lanes.h"
#include "sampling.h"

enum { MOST_ORDER = 6, MOST_FUNCTIONS = MOST_ORDER - 1 };

/* Write the half-angle vectors from each keyframe to the next, signs as given. */
static void put_steps(matrix_t keyframes, matrix_t steps) {
    const double *q = keyframes.v;
    double *to = steps.v;
    INDEPENDENT
    for (index_t i = 0; i < steps.n; i++) {
        quat_t turn = relative(quat_at(q + 4 * i), quat_at(q + 4 * i + 4));
        double size = sqrt(turn.w * turn.w + turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
        put_vec(to + 3 * i, lane_logarithm(turn, size));
    }
}

/* Even orders have their knots at the keyframes, odd ones in the middles between them, so that both
 * ends want the same number of conditions.  An end with one more has one more knot in its interval. */
static void put_breaks(const interpolation_t *asked, row_t breaks) {
    const double *t = asked->times.v;
    index_t last = asked->times.n - 1, place = 0;
    bool is_odd = asked->order % 2, with_start = has_more(asked, 0), with_end = has_more(asked, 1);
    breaks.v[place++] = t[0];
    for (index_t i = 0; i < last; i++) {
        if (i > 0 && !is_odd)
            breaks.v[place++] = t[i];
        if (last == 1 && with_start && with_end) {
            breaks.v[place++] = t[0] + (t[1] - t[0]) / 3.0;
            breaks.v[place++] = t[0] + 2.0 * (t[1] - t[0]) / 3.0;
        } else if (is_odd || (with_start && i == 0) || (with_end && i == last - 1)) {
            breaks.v[place++] = 0.5 * (t[i] + t[i + 1]);
        }
    }
    breaks.v[place] = t[last];
}

/* The first three derivatives of the three outermost functions at an end, from there inwards. */
typedef struct { double by[3][OUTERMOST]; } outer_t;

static int put_outer(row_t knots, index_t order, bool is_end, outer_t *outer) {
    index_t m = order - 1, terms = m - 1, span = is_end ? knots.n - order - 1 : order - 1;
    double values[MOST_FUNCTIONS * MOST_ORDER], rates[MOST_FUNCTIONS * MOST_FUNCTIONS];
    double bends[MOST_FUNCTIONS * MOST_FUNCTIONS];
    int found = fill_basis((indices_t){&span, 1}, knots, order, (tensor_t){values, 1, m, order},
                           (tensor_t){rates, 1, m, m}, (tensor_t){bends, 1, m, terms});
    if (found != 0)
        return found;
    double width = knots.v[span + 1] - knots.v[span];
    memset(outer, 0, sizeof *outer);
    for (index_t j = 0; j < least(m, OUTERMOST); j++) {
        index_t f = is_end ? m - 1 - j : j, at = is_end ? terms - 1 : 0;
        const double *bend = bends + f * terms;
        outer->by[0][j] = rates[f * m + (is_end ? m - 1 : 0)];
        outer->by[1][j] = bend[at];
        if (terms > 1)
            outer->by[2][j] = (double)(terms - 1) / width
                              * (is_end ? bend[at] - bend[at - 1] : bend[1] - bend[0]);
    }
    return 0;
}

/* Write the conditions that an end sets for the outermost increments.
 *
 * At an end with repeated knots only the outermost function has a slope, the outer two a curvature,
 * the outer three a third derivative, so every condition is linear.  An end without conditions has no
 * acceleration, and no jerk if it needs two conditions. */
static void put_end(const interpolation_t *asked, const outer_t *outer, index_t end,
                    system_t *system) {
    index_t ties = system->ties;
    if (!asked->known[end]) {
        for (index_t k = 0; k < ties; k++) {
            const double *derivatives = outer->by[1 + k];
            double size = 0.0;
            for (index_t j = 0; j < ties + 1; j++)
                size = fmax(size, fabs(derivatives[j]));
            for (index_t j = 0; j < ties + 1; j++)
                system->at_end[end][k][j] = derivatives[j] / size;
        }
        return;
    }
    const double *given = asked->given.v + 6 * end;
    vec_t known[2] = {times(0.5 / outer->by[0][0], vec_at(given)), vec(0.0, 0.0, 0.0)};
    if (asked->known[end] == 2) {
        vec_t bend = times(0.5, vec_at(given + 3));
        /* Seen from the last keyframe, the turn of the last factor stands before the others. */
        bend = end ? turned(exponential(known[0]), bend) : bend;
        known[1] = times(1.0 / outer->by[1][1], minus(bend, times(outer->by[1][0], known[0])));
    }
    for (index_t k = 0; k < ties; k++)
        system->at_end[end][k][k] = 1.0, system->known[end][k] = known[k];
    if (has_more(asked, end)) {
        system->taken[end] = 2, system->known[end][0] = known[1];
        system->off[end][0] = known[0], system->off[end][1] = known[1];
    }
}

/* A polynomial in Bernstein form, by de Casteljau. */
static double value_of(const double *coefficients, index_t degree, double u) {
    double b[MOST_ORDER];
    memcpy(b, coefficients, (size_t)(degree + 1) * sizeof *b);
    for (index_t k = degree; k > 0; k--)
        for (index_t j = 0; j < k; j++)
            b[j] += u * (b[j + 1] - b[j]);
    return b[0];
}

/* How much of the factors under way at each keyframe has been turned there. */
static void put_shares(const interpolation_t *asked, row_t breaks, tensor_t values,
                       system_t *system) {
    index_t last = system->rows, factors = 2 * system->ties;
    for (index_t i = 0; i <= last; i++) {
        index_t span = i + has_more(asked, 0);
        double u = asked->order % 2 ? (asked->times.v[i] - breaks.v[span])
                                      / (breaks.v[span + 1] - breaks.v[span]) : 0.0;
        for (index_t f = 0; f < factors; f++) {
            double *share = system->share + f * system->stride + i;
            bool is_taken = (i == 0 && system->taken[0]) || (i == last && system->taken[1]);
            *share = is_taken ? (f == 0 ? 1.0 : 0.0) : i == 0 && asked->order % 2 == 0 ? 0.0
                   : i == last ? 1.0
                   : value_of(values.v + (span * values.m + f) * values.k, values.k - 1, u);
        }
    }
}

static void put_system_steps(matrix_t steps, system_t *system) {
    double *to = system->step;
    for (index_t i = 0; i < steps.n; i++) {
        vec_t v = vec_at(row_of(steps, i));
        double length = norm(v), inverse = length > 0.0 ? 1.0 / length : 0.0;
        to[i] = length, to[system->stride + i] = inverse * v.x;
        to[2 * system->stride + i] = inverse * v.y, to[3 * system->stride + i] = inverse * v.z;
    }
}

INLINE quat_t turn_back(double share, const double *increment) {
    vec_t v = vec_at(increment);
    double length = norm(v), c, s;
    cosine_and_sine(-share * length, &c, &s);
    s *= length > 0.0 ? 1.0 / length : 0.0;
    return quat(c, s * v.x, s * v.y, s * v.z);
}

/* The quaternion before the product of each span, from its keyframe, so that no error accumulates
 * along the curve; what begins between keyframes continues the span before it. */
static void put_bases(const interpolation_t *asked, const system_t *system, matrix_t increments,
                      matrix_t base) {
    index_t off = has_more(asked, 0), is_odd = asked->order % 2;
    for (index_t s = 0; s < base.n; s++) {
        index_t i = s - off;
        quat_t q = quat_at(asked->keys.v);
        if (s > 0 && (is_odd || (i > 0 && i < system->rows))) {
            q = quat_at(row_of(asked->keys, i));
            for (index_t f = 2 * system->ties - 1; f >= 0; f--) {
                double share = system->share[f * system->stride + i];
                q = multiplied(q, turn_back(share, row_of(increments, s + f)));
            }
        } else if (s > 0) {
            q = multiplied(quat_at(row_of(base, s - 1)), turn_back(-1.0, row_of(increments, s - 1)));
        }
        put_quat(row_of(base, s), q);
    }
}

/* The only unknown, where everything else is known at both ends: a logarithm, the principal one as in
 * the Hermite curve.  Whole turns added to the step are left to the search. */
static bool is_explicit(const interpolation_t *asked, const system_t *system) {
    return system->rows == 1 && system->ties == 1 && asked->known[0] && asked->known[1]
        && system->step[0] <= M_PI;
}

static void put_explicit(system_t *system) {
    index_t stride = system->stride;
    const double *s = system->step;
    quat_t turn = exponential(times(s[0], vec(s[stride], s[2 * stride], s[3 * stride])));
    for (index_t end = 0; end < 2; end++) {
        put_vec(system->w + 6 * end, system->known[end][0]);
        index_t count = most(system->taken[end], 1);
        for (index_t k = 0; k < count; k++) {
            vec_t w = system->taken[end] ? system->off[end][k] : system->known[end][0];
            quat_t back = exponential(times(-1.0, w));
            turn = end ? multiplied(turn, back) : multiplied(back, turn);
        }
    }
    put_vec(system->w + 3, logarithm(turn));
}

static void put_increments(const system_t *system, matrix_t increments) {
    index_t off = system->taken[0] > 0, last = increments.n - 1;
    memcpy(row_of(increments, off), system->w, 3 * sizeof(double) * (size_t)system->count);
    if (system->taken[0])
        put_vec(increments.v, system->off[0][0]);
    if (system->taken[1])
        put_vec(row_of(increments, last), system->off[1][0]);
}

int interpolate(const interpolation_t *asked, row_t breaks, matrix_t base, matrix_t increments,
                tensor_t values) {
    index_t order = asked->order, rows = asked->keys.n - 1, spans = base.n;
    double *memory = malloc(sizeof(double) * (size_t)(spans + 1 + 2 * order + 3 * rows)
                            + sizeof(index_t) * (size_t)spans);
    system_t system = {0};
    outer_t outer[2];
    if (!memory || !new_system(rows, (order - 1) / 2, &system)) {
        free(memory);
        return OUT_OF_MEMORY;
    }
    row_t knots = {memory, spans - 1 + 2 * order};
    indices_t places = {(index_t *)(memory + knots.n), spans};
    matrix_t steps = {(double *)(places.v + spans), rows, 3};
    put_breaks(asked, breaks);
    for (index_t k = 0; k < knots.n; k++)
        knots.v[k] = breaks.v[least(most(k - order + 1, 0), spans)];
    for (index_t s = 0; s < spans; s++)
        places.v[s] = s + order - 1;
    int found = fill_basis(places, knots, order, values, (tensor_t){0}, (tensor_t){0});
    for (index_t end = 0; end < 2 && found == 0; end++)
        found = put_outer(knots, order, end, &outer[end]);
    if (found == 0) {
        if (!asked->steps.n)
            put_steps(asked->keys, steps);
        put_system_steps(asked->steps.n ? asked->steps : steps, &system);
        for (index_t end = 0; end < 2; end++)
            put_end(asked, &outer[end], end, &system);
        put_shares(asked, breaks, values, &system);
        found = FOUND;
        if (asked->is_near) {
            memcpy(system.w, row_of(increments, has_more(asked, 0)),
                   3 * sizeof(double) * (size_t)system.count);
            found = settle_increments(&system);
        } else if (is_explicit(asked, &system))
            put_explicit(&system);
        else
            found = solve_increments(&system);
        put_increments(&system, increments);
        put_bases(asked, &system, increments, base);
    }
    free(system.memory);
    free(memory);
    return found;
}
