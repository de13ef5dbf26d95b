/* The increments of an interpolating cumulative B-spline: Newton steps of its equations.
 *
 * Rows are worked off in strands, one for each lane of the vector units: long runs of neighbouring
 * rows, each begun some rows early and ended some rows late, because what lies beyond hardly counts.
 * The block tridiagonal system is eliminated as its rows are made.  Blocks are not exchanged for
 * pivots: Newton's method corrects what that costs, and what the ends of the strands cost.
 */
#include <stdlib.h>
#include <string.h>

#include "increments.h"
#include "lane_log.h"
#include "lanes.h"

enum {
    LANES = 8,
    TILE = 8,      /* rows of each strand that are loaded before any of them is worked off */
    ALONE = 48,    /* rows that are not worth a second strand */
    SHORTEST = 8,
    LONGEST = 128, /* so that what is kept of all strands stays in the cache */
    LONG_RUN = 48, /* rows to begin early and to end late: what lies beyond decays by 0.27 with each */
    ALIGNMENT = 64, /* bytes: of the widest vectors */
    KEPT = 12,     /* numbers: the block right of the diagonal and the right side, both divided */
};

/* What some rows are made from, a column for each lane.  The last four say how much of the blocks
 * left and right of the diagonal belongs to it, and whether these belong to rows of the list. */
enum {
    BEFORE = 0, HERE = 3, AFTER = 6, STEP = 9, UNDONE = 12, REST, DONE, AHEAD,
    FOLD_LEFT, FOLD_RIGHT, HAS_LEFT, HAS_RIGHT, INPUTS,
};
typedef struct { double in[INPUTS][LANES], error[3][LANES]; } inputs_t;
struct strands { inputs_t tile[TILE]; double kept[][KEPT][LANES]; };

typedef struct { vec_t x, y, z; } columns_t;

/* A factor exp(share w): the turn, and its right Jacobian times the share, by columns. */
INLINE columns_t factor(double share, vec_t w, quat_t *q) {
    double length = norm(w), inverse = length > 0.0 ? 1.0 / length : 0.0, c, s;
    vec_t n = times(inverse, w);
    cosine_and_sine(share * length, &c, &s);
    *q = quat(c, s * n.x, s * n.y, s * n.z);
    /* With the angle t = 2 share length: sin(t)/t I + (1 - sin(t)/t) n n^T - (1 - cos t)/t [n]. */
    double scaled = s * inverse, along = length > 0.0 ? scaled * c : share, across = scaled * s;
    double rest = share - along;
    vec_t m = times(rest, n), k = times(across, n);
    return (columns_t){
        vec(m.x * n.x + along, m.x * n.y - k.z, m.x * n.z + k.y),
        vec(m.y * n.x + k.z, m.y * n.y + along, m.y * n.z - k.x),
        vec(m.z * n.x - k.y, m.z * n.y + k.x, m.z * n.z + along),
    };
}

INLINE columns_t seen_after(quat_t q, columns_t a) {
    vec_t e = vec(q.x, q.y, q.z);
    return (columns_t){turned_back(q.w, e, a.x), turned_back(q.w, e, a.y),
                       turned_back(q.w, e, a.z)};
}

INLINE vec_t lane(double (*rows)[LANES], index_t i) {
    return vec(rows[0][i], rows[1][i], rows[2][i]);
}

INLINE void load_vec(double (*rows)[LANES], index_t i, vec_t v) {
    rows[0][i] = v.x, rows[1][i] = v.y, rows[2][i] = v.z;
}

INLINE columns_t folded(columns_t m, double left, columns_t a, double right, columns_t b) {
    return (columns_t){scaled_plus(left, a.x, scaled_plus(right, b.x, m.x)),
                       scaled_plus(left, a.y, scaled_plus(right, b.y, m.y)),
                       scaled_plus(left, a.z, scaled_plus(right, b.z, m.z))};
}

INLINE vec_t applied(columns_t m, vec_t v) {
    return scaled_plus(v.x, m.x, scaled_plus(v.y, m.y, times(v.z, m.z)));
}

INLINE vec_t chosen(double condition, vec_t v) {
    return vec(condition > 0.0 ? v.x : 0.0, condition > 0.0 ? v.y : 0.0,
               condition > 0.0 ? v.z : 0.0);
}

/* The half-angle vector by which a row misses its step, and its derivatives.
 *
 * With P the product of a row and e = log(E^-1 P) its error, a Newton step obeys
 * sum_f c_f R(S_f)^T J_r(2 c_f w_f) dw_f = -e, where S_f is the product of the factors after f: the
 * right Jacobian leaves a multiple of its own axis as it is, so it need not be applied to e. */
INLINE vec_t linearised(double (*in)[LANES], index_t i, columns_t *left, columns_t *middle,
                        columns_t *right) {
    quat_t a, b, c, d, e;
    vec_t here = lane(in + HERE, i);
    *right = factor(in[AHEAD][i], lane(in + AFTER, i), &d);
    columns_t by_c = seen_after(d, factor(in[DONE][i], here, &c));
    quat_t after = multiplied(c, d);
    *left = seen_after(after, factor(in[REST][i], lane(in + BEFORE, i), &b));
    after = multiplied(b, after);
    columns_t by_a = seen_after(after, factor(-in[UNDONE][i], here, &a));
    after = multiplied(a, after);
    *middle = (columns_t){plus(by_a.x, by_c.x), plus(by_a.y, by_c.y), plus(by_a.z, by_c.z)};
    factor(1.0, lane(in + STEP, i), &e);
    return lane_logarithm(multiplied(conjugated(e), after));
}

static void put_errors(inputs_t *inputs) {
    INDEPENDENT
    for (index_t i = 0; i < LANES; i++) {
        columns_t left, middle, right;
        load_vec(inputs->error, i, linearised(inputs->in, i, &left, &middle, &right));
    }
}

/* Eliminate a row of each strand: keep what the substitution needs, given what was kept of the row
 * before.
 *
 * is_given: whether the errors are there. */
INLINE void eliminate(inputs_t *inputs, bool is_given, double (*before)[LANES],
                      double (*kept)[LANES]) {
    double (*in)[LANES] = inputs->in;
    INDEPENDENT
    for (index_t i = 0; i < LANES; i++) {
        columns_t l, m, r;
        vec_t e = linearised(in, i, &l, &m, &r);
        if (is_given)
            e = lane(inputs->error, i);
        m = folded(m, in[FOLD_LEFT][i], l, in[FOLD_RIGHT][i], r);
        double linked = in[HAS_LEFT][i], ahead = in[HAS_RIGHT][i];
        m.x = minus(m.x, chosen(linked, applied(l, lane(before, i))));
        m.y = minus(m.y, chosen(linked, applied(l, lane(before + 3, i))));
        m.z = minus(m.z, chosen(linked, applied(l, lane(before + 6, i))));
        e = plus(e, chosen(linked, applied(l, lane(before + 9, i))));
        /* Where the determinant is zero, what comes is not finite, which is looked for at the end. */
        vec_t p = cross(m.y, m.z), q = cross(m.z, m.x), s = cross(m.x, m.y);
        double inverse = 1.0 / dot(m.x, p);
        p = times(inverse, p), q = times(inverse, q), s = times(inverse, s);
        r.x = chosen(ahead, r.x), r.y = chosen(ahead, r.y), r.z = chosen(ahead, r.z);
        load_vec(kept, i, vec(dot(p, r.x), dot(q, r.x), dot(s, r.x)));
        load_vec(kept + 3, i, vec(dot(p, r.y), dot(q, r.y), dot(s, r.y)));
        load_vec(kept + 6, i, vec(dot(p, r.z), dot(q, r.z), dot(s, r.z)));
        load_vec(kept + 9, i, vec(-dot(p, e), -dot(q, e), -dot(s, e)));
    }
}

/* The first or last step: what two known increments turn is taken off. */
vec_t end_step(const equations_t *equations, double scale, index_t row) {
    vec_t step = times(scale, vec_at(row_of(equations->steps, row)));
    bool off_start = row == 0 && equations->heads.n == 2;
    bool off_end = row == equations->steps.n - 1 && equations->tails.n == 2;
    if (!off_start && !off_end)
        return step;
    quat_t rest = exponential(step);
    for (index_t i = 0; off_start && i < 2; i++)
        rest = multiplied(exponential(times(-scale, vec_at(row_of(equations->heads, i)))), rest);
    for (index_t i = 0; off_end && i < 2; i++)
        rest = multiplied(rest, exponential(times(-scale, vec_at(row_of(equations->tails, i)))));
    return logarithm(rest);
}

/* The increment before the first unknown, or after the last one. */
static vec_t beyond(matrix_t known, double ratio, double scale, const double *next) {
    return known.n ? times(scale, vec_at(row_of(known, known.n - 1))) : times(ratio, vec_at(next));
}

/* Load a row into a lane. */
INLINE void load(inputs_t *inputs, index_t i, const equations_t *equations, double scale,
                 matrix_t unknown, index_t row) {
    double (*in)[LANES] = inputs->in;
    index_t last = equations->steps.n - 1;
    const double *w = row_of(unknown, row), *begun = row_of(equations->begun, row);
    load_vec(in + HERE, i, vec_at(w));
    in[UNDONE][i] = begun[1], in[REST][i] = 1.0 - begun[0];
    in[DONE][i] = begun[2], in[AHEAD][i] = begun[3];
    if (row > 0 && row < last) {
        load_vec(in + BEFORE, i, vec_at(w - 3));
        load_vec(in + AFTER, i, vec_at(w + 3));
        load_vec(in + STEP, i, times(scale, vec_at(row_of(equations->steps, row))));
        in[FOLD_LEFT][i] = in[FOLD_RIGHT][i] = 0.0;
        return;
    }
    matrix_t heads = equations->heads, tails = equations->tails;
    double before = equations->start_ratio, after = equations->end_ratio;
    load_vec(in + BEFORE, i, row > 0 ? vec_at(w - 3) : beyond(heads, before, scale, w));
    load_vec(in + AFTER, i, row < last ? vec_at(w + 3) : beyond(tails, after, scale, w));
    load_vec(in + STEP, i, end_step(equations, scale, row));
    in[FOLD_LEFT][i] = row == 0 && !heads.n ? before : 0.0;
    in[FOLD_RIGHT][i] = row == last && !tails.n ? after : 0.0;
}

/* Write the corrections of the rows that strands own, each so many, and raise the largest ones.
 *
 * begin, end: places that were eliminated, counted from where the own ones begin.
 * wanted: how many rows there are from the first strand on. */
static void substitute(double (*kept)[KEPT][LANES], index_t begin, index_t end, index_t length,
                       double *to, index_t wanted, double *largest, double *sum) {
    double x[LANES] = {0}, y[LANES] = {0}, z[LANES] = {0};
    for (index_t place = end - 1; place >= 0; place--) {
        const double (*r)[LANES] = kept[place - begin + 1];
        INDEPENDENT
        for (index_t i = 0; i < LANES; i++) {
            double p = r[9][i] - (r[0][i] * x[i] + r[3][i] * y[i] + r[6][i] * z[i]);
            double q = r[10][i] - (r[1][i] * x[i] + r[4][i] * y[i] + r[7][i] * z[i]);
            double s = r[11][i] - (r[2][i] * x[i] + r[5][i] * y[i] + r[8][i] * z[i]);
            x[i] = p, y[i] = q, z[i] = s;
        }
        if (place >= length)
            continue;
        index_t full = place < wanted ? least(LANES, (wanted - place - 1) / length + 1) : 0;
        for (index_t i = 0; i < full; i++) {
            double a = fabs(x[i]), b = fabs(y[i]), c = fabs(z[i]);
            double size = a > b ? a : b;
            size = c > size ? c : size;
            largest[i] = size > largest[i] ? size : largest[i];
            sum[i] += a + b + c;
            put_vec(to + 3 * (i * length + place), vec(x[i], y[i], z[i]));
        }
    }
}

strands_t *new_strands(index_t run, size_t more, void **rest) {
    size_t places = (size_t)(LONGEST + 2 * run + 1);
    size_t size = sizeof(strands_t) + sizeof(double) * KEPT * LANES * places;
    char *memory = aligned_alloc(ALIGNMENT, (size + more + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT);
    if (!memory)
        return NULL;
    if (rest)
        *rest = memory + size;
    strands_t *strands = (strands_t *)memory;
    memset(strands->kept[0], 0, sizeof strands->kept[0]);
    return strands;
}

/* Load a place of each strand. */
static void load_place(inputs_t *inputs, const equations_t *equations, double scale,
                       matrix_t unknown, indices_t rows, matrix_t errors, index_t first,
                       index_t length) {
    for (index_t i = 0; i < LANES; i++) {
        index_t wanted = first + i * length, place = most(0, least(wanted, rows.n - 1));
        index_t row = rows.v[place];
        load(inputs, i, equations, scale, unknown, row);
        inputs->in[HAS_LEFT][i] = wanted > 0 && wanted < rows.n && rows.v[place - 1] == row - 1;
        inputs->in[HAS_RIGHT][i] = wanted >= 0 && wanted + 1 < rows.n
                                   && rows.v[place + 1] == row + 1;
        if (errors.n)
            load_vec(inputs->error, i, vec_at(row_of(errors, place)));
    }
}

static double correct(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                      matrix_t errors, index_t run, strands_t *strands, double *correction) {
    double largest[LANES] = {0}, sum[LANES] = {0}, most_of_all = 0.0, total = 0.0;
    for (index_t done = 0; done < rows.n;) {
        index_t left = rows.n - done, length = left, begin = 0, end = left;
        if (rows.n > ALONE) {
            length = least(LONGEST, most((left + LANES - 1) / LANES, SHORTEST));
            begin = -run, end = length + run;
        }
        for (index_t from = begin; from < end; from += TILE) {
            index_t count = least(TILE, end - from);
            for (index_t i = 0; i < count; i++)
                load_place(&strands->tile[i], equations, scale, unknown, rows, errors,
                           done + from + i, length);
            for (index_t i = 0; i < count; i++) {
                double (*kept)[KEPT][LANES] = strands->kept + from + i - begin;
                eliminate(&strands->tile[i], errors.n > 0, kept[0], kept[1]);
            }
        }
        substitute(strands->kept, begin, end, length, correction + 3 * done, left, largest, sum);
        done += LANES * length;
    }
    for (index_t i = 0; i < LANES; i++) {
        most_of_all = largest[i] > most_of_all ? largest[i] : most_of_all;
        total += sum[i];
    }
    return total < INFINITY ? most_of_all : NAN;
}

double newton_step(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                   strands_t *strands, double *correction) {
    return correct(equations, scale, unknown, rows, (matrix_t){0}, SHORT_RUN, strands, correction);
}
void keyframe_errors(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                     matrix_t errors) {
    inputs_t inputs;
    for (index_t begin = 0; begin < rows.n; begin += LANES) {
        for (index_t i = 0; i < LANES; i++)
            load(&inputs, i, equations, scale, unknown, rows.v[least(begin + i, rows.n - 1)]);
        put_errors(&inputs);
        for (index_t i = 0; i < least(LANES, rows.n - begin); i++)
            put_vec(row_of(errors, begin + i), lane(inputs.error, i));
    }
}

int keyframe_step(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                  matrix_t errors, matrix_t correction, double *largest) {
    strands_t *strands = new_strands(LONG_RUN, 0, NULL);
    if (!strands)
        return OUT_OF_MEMORY;
    *largest = correct(equations, scale, unknown, rows, errors, LONG_RUN, strands, correction.v);
    free(strands);
    return FOUND;
}

int euclidean_increments(const equations_t *equations, matrix_t unknown) {
    index_t count = equations->steps.n;
    matrix_t heads = equations->heads, tails = equations->tails;
    double *above = malloc(sizeof(double) * (size_t)count);
    if (!above)
        return OUT_OF_MEMORY;
    double left_of = 0.0;
    vec_t before = {0.0, 0.0, 0.0};
    for (index_t i = 0; i < count; i++) {
        const double *begun = row_of(equations->begun, i);
        double left = 1.0 - begun[0], middle = begun[2] - begun[1], right = begun[3];
        vec_t step = vec_at(row_of(equations->steps, i));
        if (i == 0) {
            if (!heads.n)
                middle += left * equations->start_ratio;
            else if (heads.n == 1)
                step = minus(step, times(left, vec_at(heads.v)));
            else
                step = minus(minus(step, vec_at(heads.v)), vec_at(heads.v + 3));
            left = 0.0;
        }
        if (i == count - 1) {
            if (!tails.n)
                middle += right * equations->end_ratio;
            else if (tails.n == 1)
                step = minus(step, times(right, vec_at(tails.v)));
            else
                step = minus(minus(step, vec_at(tails.v)), vec_at(tails.v + 3));
            right = 0.0;
        }
        double inverse = 1.0 / (middle - left * left_of);
        before = times(inverse, minus(step, times(left, before)));
        above[i] = left_of = inverse * right;
        put_vec(row_of(unknown, i), before);
    }
    for (index_t i = count - 2; i >= 0; i--) {
        double *v = row_of(unknown, i);
        put_vec(v, minus(vec_at(v), times(above[i], vec_at(v + 3))));
    }
    free(above);
    return FOUND;
}
