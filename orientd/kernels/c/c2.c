/* The twice differentiable cumulative cubic B-spline through keyframes (Kim, Kim and Shin, 1995,
 * sec. 5.3, made to interpolate), from keyframes to the table it is sampled from. */
#include <stdlib.h>

#include "interpolation.h"
#include "lane_log.h"
#include "lanes.h"
#include "rotation.h"
#include "sampling.h"

enum { TILE = 64, PAD = 2 };

bool are_unit(matrix_t keyframes, double tolerance) {
    double largest = 0.0, sum = 0.0;
    for (index_t i = 0; i < keyframes.n; i++) {
        const double *q = row_of(keyframes, i);
        double error = fabs(sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) - 1.0);
        largest = error > largest ? error : largest;
        sum += error;
    }
    return largest <= tolerance && sum < INFINITY;
}

void put_steps(matrix_t keyframes, matrix_t steps) {
    const double *q = keyframes.v;
    double *to = steps.v;
    INDEPENDENT
    for (index_t i = 0; i < steps.n; i++) {
        quat_t turn = relative(quat_at(q + 4 * i), quat_at(q + 4 * i + 4));
        double size = sqrt(turn.w * turn.w + turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
        put_vec(to + 3 * i, lane_logarithm(turn, size));
    }
}

static void put_breaks(row_t times, bool with_start, bool with_end, row_t breaks) {
    index_t last = times.n - 1, place = 0;
    double first = times.v[0], second = times.v[1];
    for (index_t i = 0; i < last; i++) {
        breaks.v[place++] = times.v[i];
        if (last == 1 && with_start && with_end) {
            breaks.v[place++] = first + (second - first) / 3.0;
            breaks.v[place++] = first + 2.0 * (second - first) / 3.0;
        } else if ((with_start && i == 0) || (with_end && i == last - 1)) {
            breaks.v[place++] = 0.5 * (times.v[i] + times.v[i + 1]);
        }
    }
    breaks.v[place] = times.v[last];
}

/* The cumulative cubic basis where a span begins: of each of its three functions the value, the
 * derivative, half the second one and a sixth of the third one, which is constant on the span.
 *
 * The knots are simple, but for both ends, so that the recursion of de Boor has a closed form in the
 * widths of the span and of two neighbours on either side, those beyond the ends being zero. */
typedef struct { double value[3], rate[3], half_curvature[3], sixth_change[3]; } basis_t;

INLINE basis_t basis_at(double hh, double h, double here, double p, double pp) {
    double before = h + here, after = here + p;
    double first = 1.0 / (hh + before), middle = 1.0 / (before + p), third = 1.0 / (after + pp);
    double in_before = 1.0 / before, in_after = 1.0 / after, inverse = 1.0 / here;
    basis_t b;
    b.value[0] = 1.0 - here * in_before * (here * first);
    b.value[1] = h * in_before * (h * middle);
    b.value[2] = 0.0;
    b.rate[0] = 3.0 * first * (here * in_before);
    b.rate[1] = 3.0 * middle * (h * in_before);
    b.rate[2] = 0.0;
    b.half_curvature[0] = -3.0 * first * in_before;
    b.half_curvature[1] = 3.0 * middle * in_before;
    b.half_curvature[2] = 0.0;
    b.sixth_change[0] = first * in_before * inverse;
    b.sixth_change[1] = -middle * (in_before + in_after) * inverse;
    b.sixth_change[2] = third * in_after * inverse;
    return b;
}

static double width(row_t breaks, index_t span) {
    return span >= 0 && span + 1 < breaks.n ? breaks.v[span + 1] - breaks.v[span] : 0.0;
}

static basis_t basis_of(row_t breaks, index_t span) {
    return basis_at(width(breaks, span - 2), width(breaks, span - 1), width(breaks, span),
                    width(breaks, span + 1), width(breaks, span + 2));
}

/* What a velocity, and with it an acceleration, settle at an end, from there; see C2Cumulative. */
static void put_known(const double *given, double rate, double first, double second, double *known) {
    vec_t outer = times(1.0 / (2.0 * rate), vec_at(given));
    put_vec(known, outer);
    vec_t inner = minus(times(0.5, vec_at(given + 3)), times(first, outer));
    put_vec(known + 3, times(1.0 / second, inner));
}

void put_equations(row_t instants, tensor_t given, index_t start_known, index_t end_known,
                   row_t breaks, matrix_t begun, tensor_t known, row_t ratios) {
    index_t last = instants.n - 1, spans = breaks.n - 1;
    bool with_start = start_known == 2, with_end = end_known == 2;
    put_breaks(instants, with_start, with_end, breaks);
    for (index_t i = 0; i <= last; i++) {
        double *to = row_of(begun, i);
        if (i == 0) {
            to[0] = with_start ? 1.0 : 0.0, to[1] = 0.0;
        } else if (i == last) {
            to[0] = 1.0, to[1] = with_end ? 0.0 : 1.0;
        } else {
            basis_t b = basis_of(breaks, i + with_start);
            to[0] = b.value[0], to[1] = b.value[1];
        }
    }
    double h = width(breaks, 0), more = h + width(breaks, 1);
    put_known(given.v, 3.0 / h, -6.0 / (h * h), 6.0 / (h * more), known.v);
    ratios.v[0] = h / more;
    h = width(breaks, spans - 1), more = h + width(breaks, spans - 2);
    /* The turn of the last factor stands between the acceleration and the factor before it. */
    double end[6];
    put_vec(end, vec_at(given.v + 6));
    quat_t outer = exponential(times(h / 6.0, vec_at(end)));
    put_vec(end + 3, turned(outer, vec_at(given.v + 9)));
    put_known(end, 3.0 / h, 6.0 / (h * h), -6.0 / (h * more), known.v + 6);
    ratios.v[1] = h / more;
}

/* Increments as lengths and unit axes, a row for each, and widths of spans with zeros around. */
typedef struct { double *restrict length, *restrict x, *restrict y, *restrict z, *restrict h; } parts_t;

INLINE quat_t turn_back(parts_t w, index_t i, double share) {
    double c, s;
    cosine_and_sine(-share * w.length[i], &c, &s);
    return quat(c, s * w.x[i], s * w.y[i], s * w.z[i]);
}

/* The quaternion before the product of each span that begins at a keyframe, from the keyframe, so
 * that no error accumulates along the curve. */
static void put_bases(matrix_t keyframes, index_t off, parts_t w, double *restrict out,
                      index_t spans) {
    const double *restrict keys = keyframes.v, *restrict h = w.h;
    INDEPENDENT
    for (index_t i = 1; i < keyframes.n - 1; i++) {
        index_t s = i + off;
        double before = h[s - 1] + h[s];
        double a = 1.0 - h[s] / before * (h[s] / (h[s - 2] + before));
        double b = h[s - 1] / before * (h[s - 1] / (before + h[s + 1]));
        quat_t q = multiplied(turn_back(w, s + 1, b), turn_back(w, s, a));
        q = multiplied(quat_at(keys + 4 * i), q);
        out[s] = q.w, out[spans + s] = q.x, out[2 * spans + s] = q.y, out[3 * spans + s] = q.z;
    }
}

/* The factors of each span: coefficients of the half angle, and the axis. */
static void put_factors(parts_t w, double *restrict out, index_t spans) {
    const double *restrict h = w.h;
    INDEPENDENT
    for (index_t s = 0; s < spans; s++) {
        basis_t b = basis_at(h[s - 2], h[s - 1], h[s], h[s + 1], h[s + 2]);
        for (index_t f = 0; f < 3; f++) {
            double length = w.length[s + f];
            double *to = out + (4 + 7 * f) * spans + s;
            to[0] = length * b.value[f];
            to[spans] = length * b.rate[f];
            to[2 * spans] = length * b.half_curvature[f];
            to[3 * spans] = length * b.sixth_change[f];
            to[4 * spans] = w.x[s + f], to[5 * spans] = w.y[s + f], to[6 * spans] = w.z[s + f];
        }
    }
}

int put_table(matrix_t keyframes, bool with_start, row_t breaks, matrix_t solved, matrix_t table) {
    index_t spans = table.m, count = spans + 2;
    double *memory = malloc(sizeof(double) * (size_t)(4 * count + spans + 2 * PAD));
    if (!memory)
        return OUT_OF_MEMORY;
    parts_t w = {memory, memory + count, memory + 2 * count, memory + 3 * count,
                 memory + 4 * count + PAD};
    for (index_t k = 0; k < PAD; k++)
        w.h[-1 - k] = w.h[spans + k] = 0.0;
    for (index_t s = 0; s < spans; s++)
        w.h[s] = breaks.v[s + 1] - breaks.v[s];
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        vec_t v = vec_at(solved.v + 3 * i);
        double length = norm(v), inverse = length > 0.0 ? 1.0 / length : 1.0;
        w.length[i] = length;
        w.x[i] = inverse * v.x, w.y[i] = inverse * v.y, w.z[i] = inverse * v.z;
    }
    put_bases(keyframes, with_start, w, table.v, spans);
    put_factors(w, table.v, spans);
    /* The first span begins with the first keyframe; what begins between keyframes continues the
     * span before it. */
    index_t keyed = keyframes.n - 2 + with_start;
    for (index_t s = 0; s < spans; s++) {
        if (s > with_start && s <= keyed)
            s = keyed + 1;
        if (s >= spans)
            break;
        double *to = table.v + s;
        quat_t q = quat_at(keyframes.v);
        if (s > 0) {
            q = quat(to[-1], to[spans - 1], to[2 * spans - 1], to[3 * spans - 1]);
            q = multiplied(q, exponential(vec_at(row_of(solved, s - 1))));
        }
        to[0] = q.w, to[spans] = q.x, to[2 * spans] = q.y, to[3 * spans] = q.z;
    }
    free(memory);
    return FOUND;
}

/* Write what the ends settle around the unknown increments. */
static void complete(const equations_t *equations, matrix_t solved) {
    index_t last = solved.n - 1;
    put_vec(solved.v, times(equations->start_ratio, vec_at(row_of(solved, 1))));
    put_vec(row_of(solved, last), times(equations->end_ratio, vec_at(row_of(solved, last - 1))));
    for (index_t i = 0; i < equations->heads.n; i++)
        put_vec(row_of(solved, i), vec_at(row_of(equations->heads, i)));
    for (index_t i = 0; i < equations->tails.n; i++)
        put_vec(row_of(solved, last - i), vec_at(row_of(equations->tails, i)));
}

index_t interpolate_c2(matrix_t keys, row_t instants, tensor_t given, index_t start_known,
                       index_t end_known, row_t breaks, matrix_t table, matrix_t solved) {
    index_t count = keys.n;
    double *memory = malloc(sizeof(double) * (size_t)(3 * count + 2 * count));
    if (!memory)
        return OUT_OF_MEMORY;
    double known[12], ratios[2];
    matrix_t unknown = {row_of(solved, most(1, start_known)), count - 1, 3};
    equations_t equations = {
        .steps = {memory, count - 1, 3}, .begun = {memory + 3 * count, count, 2},
        .heads = {known, start_known, 3}, .tails = {known + 6, end_known, 3},
    };
    put_steps(keys, equations.steps);
    put_equations(instants, given, start_known, end_known, breaks, equations.begun,
                  (tensor_t){known, 2, 2, 3}, (row_t){ratios, 2});
    equations.start_ratio = ratios[0], equations.end_ratio = ratios[1];
    index_t found = find_increments(&equations, unknown, 0);
    if (found == unknown.n) {
        complete(&equations, solved);
        if (put_table(keys, start_known == 2, breaks, solved, table) == OUT_OF_MEMORY)
            found = OUT_OF_MEMORY;
    }
    free(memory);
    return found;
}
