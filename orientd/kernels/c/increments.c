/* The increments of an interpolating cumulative B-spline: Newton steps of its equations.
 *
 * Strands are eliminated side by side, each begun some places early and ended some places late,
 * because what lies beyond hardly counts.  Blocks are not exchanged for pivots: Newton's method
 * corrects what that costs, and what the ends of the strands cost.
 */
#include <stdlib.h>
#include <string.h>

#include "increments.h"
#include "lane_log.h"
#include "lanes.h"

/* What the factors of an increment have in common, a row for each: its axis, and of its shares at
 * the keyframe before, at the one after and from there on cosine and sine of the half angle and
 * what their derivatives are made of. */
enum { AXIS = 0, AT_BEFORE = 3, AT_AFTER = 8, REST = 13, TURNS = 18 };
enum { COSINE, SINE, ALONG, ACROSS, BESIDE };

typedef struct { vec_t x, y, z; } columns_t;

INLINE vec_t lane(const double *rows, index_t i) {
    return vec(rows[i], rows[LANES + i], rows[2 * LANES + i]);
}

INLINE void load_vec(lanes_t *rows, index_t i, vec_t v) {
    rows[0][i] = v.x, rows[1][i] = v.y, rows[2][i] = v.z;
}

INLINE columns_t columns_at(const double *rows, index_t i) {
    return (columns_t){lane(rows, i), lane(rows + 3 * LANES, i), lane(rows + 6 * LANES, i)};
}

INLINE void load_columns(lanes_t *rows, index_t i, columns_t m) {
    load_vec(rows, i, m.x), load_vec(rows + 3, i, m.y), load_vec(rows + 6, i, m.z);
}

INLINE columns_t transposed(columns_t m) {
    return (columns_t){vec(m.x.x, m.y.x, m.z.x), vec(m.x.y, m.y.y, m.z.y), vec(m.x.z, m.y.z, m.z.z)};
}

INLINE vec_t applied(columns_t m, vec_t v) {
    return scaled_plus(v.x, m.x, scaled_plus(v.y, m.y, times(v.z, m.z)));
}

/* With the angle t = 2 share |w|: sin(t)/t, (1 - cos t)/t and 1 - sin(t)/t, times the share. */
INLINE void put_turn(double share, double length, double inverse, lanes_t *to, index_t i) {
    double c, s;
    cosine_and_sine(share * length, &c, &s);
    double scaled = s * inverse, along = length > 0.0 ? scaled * c : share;
    to[COSINE][i] = c, to[SINE][i] = s, to[ALONG][i] = along, to[ACROSS][i] = scaled * s;
    to[BESIDE][i] = share - along;
}

static void put_turns(lanes_t *restrict w, lanes_t *restrict shares, lanes_t *restrict turns) {
    INDEPENDENT
    for (index_t i = 0; i < LANES; i++) {
        vec_t v = lane(w[0], i);
        double length = norm(v), inverse = length > 0.0 ? 1.0 / length : 0.0;
        load_vec(turns + AXIS, i, times(inverse, v));
        put_turn(shares[0][i], length, inverse, turns + AT_BEFORE, i);
        put_turn(shares[1][i], length, inverse, turns + AT_AFTER, i);
        put_turn(1.0 - shares[1][i], length, inverse, turns + REST, i);
    }
}

INLINE quat_t turn_at(lanes_t *turns, index_t share, index_t i) {
    double s = turns[share + SINE][i];
    vec_t n = lane(turns[AXIS], i);
    return quat(turns[share + COSINE][i], s * n.x, s * n.y, s * n.z);
}

/* The left Jacobian of a factor times its share, by columns: along I + beside n n^T + across [n].
 * The right one is its transpose. */
INLINE columns_t jacobian_at(lanes_t *turns, index_t share, index_t i) {
    vec_t n = lane(turns[AXIS], i);
    double along = turns[share + ALONG][i];
    vec_t m = times(turns[share + BESIDE][i], n), k = times(turns[share + ACROSS][i], n);
    return (columns_t){
        vec(m.x * n.x + along, m.x * n.y + k.z, m.x * n.z - k.y),
        vec(m.y * n.x - k.z, m.y * n.y + along, m.y * n.z + k.x),
        vec(m.z * n.x + k.y, m.z * n.y - k.x, m.z * n.z + along),
    };
}

INLINE columns_t all_turned_back(quat_t q, columns_t a) {
    vec_t e = vec(q.x, q.y, q.z);
    return (columns_t){turned_back(q.w, e, a.x), turned_back(q.w, e, a.y),
                       turned_back(q.w, e, a.z)};
}

/* The rows of a place: by which half-angle vectors they miss their steps, and its derivatives.
 *
 * With P = a b c d the product of a row and e = log(E^-1 P) its error, a Newton step obeys
 * sum_f R(S_f)^T J_f dw_f = -e, where S_f is the product of the factors after f and J_f the right
 * Jacobian times the share: the one of e leaves a multiple of its own axis as it is, so it need not
 * be applied.  All is seen before c, where least is left to be turned. */
static void linearise(const double *restrict is_given, lanes_t *restrict before, lanes_t *restrict here,
                      lanes_t *restrict after, lanes_t *restrict target, lanes_t *restrict error,
                      lanes_t *restrict system) {
    INDEPENDENT
    for (index_t i = 0; i < LANES; i++) {
        quat_t a = conjugated(turn_at(here, AT_BEFORE, i)), b = turn_at(before, REST, i);
        quat_t c = turn_at(here, AT_AFTER, i), d = turn_at(after, AT_BEFORE, i);
        quat_t late = multiplied(c, d);
        /* The share is negative here, the Jacobian as seen after the factor. */
        columns_t by_a = all_turned_back(b, jacobian_at(here, AT_BEFORE, i));
        columns_t by_c = jacobian_at(here, AT_AFTER, i);
        columns_t middle = {minus(by_c.x, by_a.x), minus(by_c.y, by_a.y), minus(by_c.z, by_a.z)};
        load_columns(system, i, transposed(jacobian_at(before, REST, i)));
        load_columns(system + 9, i, middle);
        load_columns(system + 18, i,
                     all_turned_back(conjugated(c), jacobian_at(after, AT_BEFORE, i)));
        quat_t step = quat(target[0][i], target[1][i], target[2][i], target[3][i]);
        quat_t product = multiplied(multiplied(a, b), late);
        vec_t e = lane_logarithm(multiplied(conjugated(step), product), 1.0);
        vec_t given = lane(error[0], i);
        e = is_given[i] > 0.0 ? given : e;
        load_vec(error, i, e);
        load_vec(system + 27, i,
                 turned_back(late.w, vec(-late.x, -late.y, -late.z), e));
    }
}

/* Write the row of an item that stands still, or that is to be a multiple of a neighbour. */
static void put_tie(window_t *window, tie_t tie) {
    index_t p = tie.item % window->length, i = tie.item / window->length;
    lanes_t *row = window->system[p], *w = window->w[p + 1];
    for (index_t k = 0; k < 30; k++)
        row[k][i] = 0.0;
    for (index_t k = 0; k < 3; k++) {
        row[4 * k][i] = -tie.of_before, row[9 + 4 * k][i] = 1.0, row[18 + 4 * k][i] = -tie.of_after;
        if (tie.of_before != 0.0 || tie.of_after != 0.0)
            row[27 + k][i] = w[k][i] - tie.of_before * window->w[p][k][i]
                             - tie.of_after * window->w[p + 2][k][i];
    }
}

/* Write the rows of all places, and of those that stand still that they do. */
static void put_system(window_t *window, bool is_given) {
    index_t last = window->length + 1;
    lanes_t turns[3][TURNS], given;
    for (index_t i = 0; i < LANES; i++) {
        bool is_first = i == 0, is_last = i == LANES - 1;
        given[i] = is_given;
        for (index_t k = 0; k < 3; k++) {
            window->w[0][k][i] = is_first ? 0.0 : window->w[last - 1][k][i - 1];
            window->w[last][k][i] = is_last ? 0.0 : window->w[1][k][i + 1];
        }
        for (index_t k = 0; k < 2; k++) {
            window->shares[0][k][i] = is_first ? (double)k : window->shares[last - 1][k][i - 1];
            window->shares[last][k][i] = is_last ? (double)k : window->shares[1][k][i + 1];
        }
    }
    put_turns(window->w[0], window->shares[0], turns[0]);
    put_turns(window->w[1], window->shares[1], turns[1]);
    for (index_t p = 0; p < window->length; p++) {
        put_turns(window->w[p + 2], window->shares[p + 2], turns[(p + 2) % 3]);
        linearise(given, turns[p % 3], turns[(p + 1) % 3], turns[(p + 2) % 3],
                  window->target[p], window->error[p], window->system[p]);
    }
    for (index_t k = 0; k < window->ties; k++)
        put_tie(window, window->tie[k]);
}

/* Eliminate a row: keep what the substitution needs, given what was kept of the row before. */
INLINE void eliminate(const double *row, index_t i, const double *before, index_t j,
                      lanes_t *kept) {
    columns_t l = columns_at(row, i), m = columns_at(row + 9 * LANES, i);
    columns_t r = columns_at(row + 18 * LANES, i);
    vec_t e = lane(row + 27 * LANES, i);
    m.x = minus(m.x, applied(l, lane(before, j)));
    m.y = minus(m.y, applied(l, lane(before + 3 * LANES, j)));
    m.z = minus(m.z, applied(l, lane(before + 6 * LANES, j)));
    e = plus(e, applied(l, lane(before + 9 * LANES, j)));
    /* Where the determinant is zero, what comes is not finite, which is looked for at the end. */
    vec_t p = cross(m.y, m.z), q = cross(m.z, m.x), s = cross(m.x, m.y);
    double inverse = 1.0 / dot(m.x, p);
    p = times(inverse, p), q = times(inverse, q), s = times(inverse, s);
    load_vec(kept, i, vec(dot(p, r.x), dot(q, r.x), dot(s, r.x)));
    load_vec(kept + 3, i, vec(dot(p, r.y), dot(q, r.y), dot(s, r.y)));
    load_vec(kept + 6, i, vec(dot(p, r.z), dot(q, r.z), dot(s, r.z)));
    load_vec(kept + 9, i, vec(-dot(p, e), -dot(q, e), -dot(s, e)));
}

/* shift: 0 for rows of the own strand, -1 or 1 for those of the strand before or after. */
static void eliminate_all(const double *restrict row, index_t shift, lanes_t *restrict before,
                          lanes_t *restrict kept) {
    row += shift;
    INDEPENDENT
    for (index_t i = 0; i < LANES; i++)
        eliminate(row, i, before[0], i, kept);
}

INLINE vec_t substituted(const double *kept, index_t i, vec_t after) {
    return minus(lane(kept + 9 * LANES, i), applied(columns_at(kept, i), after));
}

double newton_step(window_t *window) {
    index_t length = window->length, overlap = length < window->count ? OVERLAP : 0;
    put_system(window, false);
    lanes_t (*kept)[12] = window->kept;
    memset(kept[-overlap - 1], 0, sizeof *kept);
    for (index_t p = -overlap; p < 0; p++)
        eliminate_all(window->system[length + p][0], -1, kept[p - 1], kept[p]);
    for (index_t k = 0; k < 12; k++)
        kept[-1][k][0] = 0.0;
    for (index_t p = 0; p < length; p++)
        eliminate_all(window->system[p][0], 0, kept[p - 1], kept[p]);
    for (index_t p = 0; p < overlap; p++)
        eliminate_all(window->system[p][0], 1, kept[length + p - 1], kept[length + p]);

    lanes_t next[3] = {0}, largest = {0}, total = {0};
    for (index_t p = length + overlap - 1; p >= length; p--) {
        INDEPENDENT
        for (index_t i = 0; i < LANES; i++)
            load_vec(next, i, substituted(kept[p][0], i, lane(next[0], i)));
    }
    load_vec(next, LANES - 1, vec(0.0, 0.0, 0.0));
    for (index_t p = length - 1; p >= 0; p--) {
        lanes_t *w = window->w[p + 1];
        INDEPENDENT
        for (index_t i = 0; i < LANES; i++) {
            vec_t d = substituted(kept[p][0], i, lane(next[0], i));
            load_vec(next, i, d);
            load_vec(kept[p] + 9, i, d);
            load_vec(w, i, plus(lane(w[0], i), d));
            double a = fabs(d.x), b = fabs(d.y), c = fabs(d.z), size = a > b ? a : b;
            size = c > size ? c : size;
            largest[i] = size > largest[i] ? size : largest[i];
            total[i] += a + b + c;
        }
    }
    double size = 0.0, all = 0.0;
    for (index_t i = 0; i < LANES; i++)
        size = largest[i] > size ? largest[i] : size, all += total[i];
    return all < INFINITY ? size : NAN;
}

/* Rows as Python lists them. */
static int open_rows(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                     window_t *window) {
    bool *moves = calloc((size_t)equations->steps.n + 4, sizeof *moves);
    if (!moves || !new_window(equations, window)) {
        free(moves);
        return OUT_OF_MEMORY;
    }
    for (index_t k = 0; k < rows.n; k++)
        moves[rows.v[k] + 2] = true;
    open_window(window, scale, unknown, moves + 2);
    free(moves);
    return FOUND;
}

/* Return the item of a row, from the one of a row before on. */
static index_t item_of(const window_t *window, index_t row, index_t from) {
    while (window->which[from] < row)
        from++;
    return from;
}

int keyframe_errors(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                    matrix_t errors) {
    window_t window;
    if (open_rows(equations, scale, unknown, rows, &window) != FOUND)
        return OUT_OF_MEMORY;
    put_system(&window, false);
    for (index_t k = 0, item = 0; k < rows.n; k++) {
        item = item_of(&window, rows.v[k], item);
        put_vec(row_of(errors, k), lane(window.error[item % window.length][0], item / window.length));
    }
    free(window.memory);
    return FOUND;
}

/* All rows one after the other, so that nothing is left to a next step. */
int keyframe_step(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                  matrix_t errors, matrix_t correction) {
    window_t window;
    if (open_rows(equations, scale, unknown, rows, &window) != FOUND)
        return OUT_OF_MEMORY;
    index_t length = window.length;
    for (index_t k = 0, item = 0; k < errors.n; k++) {
        item = item_of(&window, rows.v[k], item);
        load_vec(window.error[item % length], item / length, vec_at(row_of(errors, k)));
    }
    put_system(&window, errors.n > 0);
    const double *before = memset(window.kept[-1], 0, sizeof *window.kept);
    for (index_t k = 0, j = 0; k < window.count; k++) {
        lanes_t *kept = window.kept[k % length];
        eliminate(window.system[k % length][0], k / length, before, j, kept);
        before = kept[0], j = k / length;
    }
    vec_t next = {0.0, 0.0, 0.0};
    for (index_t k = window.count - 1, row = rows.n - 1; k >= 0; k--) {
        next = substituted(window.kept[k % length][0], k / length, next);
        if (row >= 0 && window.which[k] == rows.v[row])
            put_vec(row_of(correction, row--), next);
    }
    free(window.memory);
    return FOUND;
}
