/* The increments of an interpolating cumulative B-spline: its equations, and Newton's method.
 *
 * Rows are written a tile at a time in loops that go to the vector units.  The block tridiagonal
 * system is eliminated as its rows are made, so that only what the substitution needs is kept.
 * Blocks are not exchanged for pivots: Newton's method corrects what that costs.
 */
#include <stdlib.h>
#include <string.h>

#include "interpolation.h"
#include "lane_log.h"
#include "lanes.h"
#include "rotation.h"

enum {
    TILE = 32,
    PIECE = 512, /* rows that are substituted together, so that what they need stays in the cache */
    HALO = 48,   /* of the rows after them, too: what lies beyond decays by 0.27 with each keyframe */
    KEPT = 12,   /* numbers: the block right of the diagonal and the right side, both divided */
    REACH = 12,  /* how far around a row that still moves others are corrected, too */
    MOST_STEPS = 30,
    MOST_ATTEMPTS = 2,
};

/* The first correction must not be longer, in rad of half angle, and each must be a share of the
 * one before it, or the search is not under control. */
static const double LARGEST_FIRST = 1.2, CONTRACTION = 0.6;
static const double SMALLEST_GROWTH = 0.01;
/* How small a correction has to be before the full scale is reached. */
static const double ON_THE_WAY = 1e-2;
/* After a correction so small the next one, its square, is lost in rounding. */
static const double SETTLED = 1e-9;
static const double ROUNDING = 1e-7;

/* What a tile is made from, and what becomes of it, a column for each row of the system. */
enum {
    BEFORE = 0, HERE = 3, AFTER = 6, STEP = 9, UNDONE = 12, REST, DONE, AHEAD, INPUTS,
    LEFT = 0, MIDDLE = 9, RIGHT = 18, ERROR = 27, OUTPUTS = 30,
};
typedef struct { double in[INPUTS][TILE], out[OUTPUTS][TILE]; } tile_t;

typedef struct { vec_t x, y, z; } columns_t;

/* A factor exp(share w): the turn, and its right Jacobian times the share, by columns. */
INLINE columns_t factor(double share, vec_t w, quat_t *q) {
    double length = norm(w), c, s;
    vec_t n = times(length > 0.0 ? 1.0 / length : 0.0, w);
    double half = share * length;
    cosine_and_sine(half, &c, &s);
    *q = quat(c, s * n.x, s * n.y, s * n.z);
    /* With the angle t = 2 half: sin(t)/t I + (1 - sin(t)/t) n n^T - (1 - cos t)/t [n]. */
    double ratio = half != 0.0 ? s / half : 1.0;
    double along = share * (ratio * c), across = share * (ratio * s), rest = share - along;
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

INLINE void put_columns(double *to, columns_t a) {
    to[0] = a.x.x, to[TILE] = a.y.x, to[2 * TILE] = a.z.x;
    to[3 * TILE] = a.x.y, to[4 * TILE] = a.y.y, to[5 * TILE] = a.z.y;
    to[6 * TILE] = a.x.z, to[7 * TILE] = a.y.z, to[8 * TILE] = a.z.z;
}

INLINE vec_t lane(const double *first) {
    return vec(first[0], first[TILE], first[2 * TILE]);
}

/* Write derivatives and errors of the rows of a tile.
 *
 * With P the product of a row and e = log(E^-1 P) its error, a Newton step obeys
 * sum_f c_f R(S_f)^T J_r(2 c_f w_f) dw_f = -e, where S_f is the product of the factors after f: the
 * right Jacobian leaves a multiple of its own axis as it is, so it need not be applied to e. */
static void linearise(tile_t *tile, index_t count) {
    double *restrict in = tile->in[0], *restrict out = tile->out[0];
    /* Whole vectors: places that are not in use hold what is in the first one. */
    index_t padded = least((count + 7) / 8 * 8, TILE);
    for (index_t row = 0; row < INPUTS; row++)
        for (index_t i = count; i < padded; i++)
            in[row * TILE + i] = in[row * TILE + 0];
    INDEPENDENT
    for (index_t i = 0; i < padded; i++) {
        quat_t a, b, c, d, e;
        vec_t here = lane(in + HERE * TILE + i);
        columns_t by_d = factor(in[AHEAD * TILE + i], lane(in + AFTER * TILE + i), &d);
        columns_t by_c = seen_after(d, factor(in[DONE * TILE + i], here, &c));
        quat_t after = multiplied(c, d);
        columns_t by_b = seen_after(after, factor(in[REST * TILE + i], lane(in + BEFORE * TILE + i), &b));
        after = multiplied(b, after);
        columns_t by_a = seen_after(after, factor(-in[UNDONE * TILE + i], here, &a));
        after = multiplied(a, after);
        factor(1.0, lane(in + STEP * TILE + i), &e);
        vec_t error = lane_logarithm(multiplied(conjugated(e), after));
        put_columns(&out[LEFT * TILE + i], by_b);
        put_columns(&out[MIDDLE * TILE + i], (columns_t){plus(by_a.x, by_c.x), plus(by_a.y, by_c.y),
                                                 plus(by_a.z, by_c.z)});
        put_columns(&out[RIGHT * TILE + i], by_d);
        out[ERROR * TILE + i] = error.x, out[(ERROR + 1) * TILE + i] = error.y, out[(ERROR + 2) * TILE + i] = error.z;
    }
}

/* The first or last step: what two known increments turn is taken off. */
static vec_t end_step(const equations_t *equations, double scale, index_t row) {
    vec_t step = times(scale, vec_at(row_of(equations->steps, row)));
    bool off_start = row == 0 && equations->heads.n == 2;
    bool off_end = row == equations->steps.n - 1 && equations->tails.n == 2;
    quat_t rest = exponential(step);
    for (index_t i = 0; off_start && i < 2; i++)
        rest = multiplied(exponential(times(-scale, vec_at(row_of(equations->heads, i)))), rest);
    for (index_t i = 0; off_end && i < 2; i++)
        rest = multiplied(rest, exponential(times(-scale, vec_at(row_of(equations->tails, i)))));
    return off_start || off_end ? logarithm(rest) : step;
}

/* The increment before the first unknown, or after the last one. */
static vec_t beyond(matrix_t known, double ratio, double scale, const double *next) {
    return known.n ? times(scale, vec_at(row_of(known, known.n - 1))) : times(ratio, vec_at(next));
}

INLINE void load_vec(double (*rows)[TILE], index_t i, vec_t v) {
    rows[0][i] = v.x, rows[1][i] = v.y, rows[2][i] = v.z;
}

/* Fill a tile with rows, their numbers given, and work it off. */
static void load(tile_t *tile, const equations_t *equations, double scale, matrix_t unknown,
                 const int64_t *rows, index_t count) {
    index_t last = equations->steps.n - 1;
    for (index_t i = 0; i < count; i++) {
        index_t row = rows[i];
        const double *w = row_of(unknown, row), *begun = row_of(equations->begun, row);
        load_vec(tile->in + HERE, i, vec_at(w));
        load_vec(tile->in + BEFORE, i, row > 0 ? vec_at(w - 3) : beyond(
            equations->heads, equations->start_ratio, scale, w));
        load_vec(tile->in + AFTER, i, row < last ? vec_at(w + 3) : beyond(
            equations->tails, equations->end_ratio, scale, w));
        load_vec(tile->in + STEP, i, row > 0 && row < last
            ? times(scale, vec_at(row_of(equations->steps, row)))
            : end_step(equations, scale, row));
        tile->in[UNDONE][i] = begun[1];
        tile->in[REST][i] = 1.0 - begun[0];
        tile->in[DONE][i] = begun[2];
        tile->in[AHEAD][i] = begun[3];
    }
    linearise(tile, count);
}

/* Fold the block of an increment that is a multiple of its neighbour into the diagonal. */
static void fold(tile_t *tile, index_t i, index_t side, matrix_t known, double ratio) {
    for (index_t k = 0; k < 9; k++) {
        if (!known.n)
            tile->out[MIDDLE + k][i] += ratio * tile->out[side + k][i];
        tile->out[side + k][i] = 0.0;
    }
}

/* Eliminate a row: keep what the substitution needs, given what was kept of the row before. */
INLINE void eliminate(const tile_t *tile, index_t i, const double *before, double *kept) {
    double m[9], r[KEPT];
    for (index_t k = 0; k < 9; k++)
        m[k] = tile->out[MIDDLE + k][i];
    for (index_t k = 0; k < 3; k++) {
        for (index_t j = 0; j < 3; j++)
            r[4 * k + j] = tile->out[RIGHT + 3 * k + j][i];
        r[4 * k + 3] = -tile->out[ERROR + k][i];
    }
    if (before)
        for (index_t k = 0; k < 3; k++) {
            double x = tile->out[LEFT + 3 * k][i], y = tile->out[LEFT + 3 * k + 1][i];
            double z = tile->out[LEFT + 3 * k + 2][i];
            for (index_t j = 0; j < 3; j++)
                m[3 * k + j] -= x * before[j] + y * before[4 + j] + z * before[8 + j];
            r[4 * k + 3] -= x * before[3] + y * before[7] + z * before[11];
        }
    double c[9] = {
        m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
        m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
        m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3],
    };
    /* Where the determinant is zero, what comes is not finite, which is looked for at the end. */
    double inverse = 1.0 / (m[0] * c[0] + m[1] * c[3] + m[2] * c[6]);
    for (index_t k = 0; k < 9; k++)
        c[k] *= inverse;
    for (index_t k = 0; k < 3; k++)
        for (index_t j = 0; j < 4; j++)
            kept[4 * k + j] = c[3 * k] * r[j] + c[3 * k + 1] * r[4 + j] + c[3 * k + 2] * r[8 + j];
}

/* Write the corrections of all rows that are kept but the last ones, which others follow. */
static void substitute(double *kept, index_t held, index_t wanted, double *to,
                       double *largest) {
    double x = 0.0, y = 0.0, z = 0.0;
    for (index_t i = held - 1; i >= 0; i--) {
        const double *r = kept + KEPT * i;
        double p = r[3] - (r[0] * x + r[1] * y + r[2] * z);
        double q = r[7] - (r[4] * x + r[5] * y + r[6] * z);
        z = r[11] - (r[8] * x + r[9] * y + r[10] * z);
        x = p, y = q;
        if (i < wanted) {
            double *v = to + 3 * i;
            v[0] = x, v[1] = y, v[2] = z;
            double size = fmax(fmax(fabs(x), fabs(y)), fabs(z));
            /* Not `>`: what is not a number must not pass for small. */
            if (!(size <= *largest) || x != x || y != y || z != z)
                *largest = x != x || y != y || z != z ? NAN : size;
        }
    }
}

static double step_of(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                      matrix_t errors, double *correction, double *kept, tile_t *tile) {
    index_t last = equations->steps.n - 1, done = 0, held = 0;
    double largest = 0.0;
    for (index_t begin = 0; begin < rows.n; begin += TILE) {
        index_t count = least(TILE, rows.n - begin);
        load(tile, equations, scale, unknown, rows.v + begin, count);
        if (errors.n)
            for (index_t i = 0; i < count; i++)
                load_vec(tile->out + ERROR, i, vec_at(row_of(errors, begin + i)));
        for (index_t i = 0; i < count; i++) {
            index_t place = begin + i, row = rows.v[place];
            if (row == 0)
                fold(tile, i, LEFT, equations->heads, equations->start_ratio);
            if (row == last)
                fold(tile, i, RIGHT, equations->tails, equations->end_ratio);
            if (place + 1 == rows.n || rows.v[place + 1] != row + 1)
                for (index_t k = 0; k < 9; k++)
                    tile->out[RIGHT + k][i] = 0.0;
            bool follows = place > 0 && rows.v[place - 1] == row - 1;
            eliminate(tile, i, follows ? kept + KEPT * (held - 1) : NULL, kept + KEPT * held);
            held++;
        }
        if (held > PIECE + HALO - TILE) {
            index_t ready = held - HALO;
            substitute(kept, held, ready, correction + 3 * done, &largest);
            memmove(kept, kept + KEPT * ready, sizeof(double) * KEPT * HALO);
            done += ready, held = HALO;
        }
    }
    substitute(kept, held, held, correction + 3 * done, &largest);
    return largest;
}

void keyframe_errors(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                     matrix_t errors) {
    tile_t tile;
    for (index_t begin = 0; begin < rows.n; begin += TILE) {
        index_t count = least(TILE, rows.n - begin);
        load(&tile, equations, scale, unknown, rows.v + begin, count);
        for (index_t i = 0; i < count; i++)
            put_vec(row_of(errors, begin + i), lane(&tile.out[ERROR][i]));
    }
}

int keyframe_step(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                  matrix_t errors, matrix_t correction, double *largest) {
    tile_t tile;
    double *kept = malloc(sizeof(double) * KEPT * (PIECE + HALO));
    if (!kept)
        return OUT_OF_MEMORY;
    *largest = step_of(equations, scale, unknown, rows, errors, correction.v, kept, &tile);
    free(kept);
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

/* What a search needs: increments and corrections, shape (N, 3) each, and lists of rows. */
typedef struct {
    const equations_t *equations;
    matrix_t tangent; /* the increments of Euclidean space */
    matrix_t here;    /* where the search is */
    double *bend, *bend_before, *trial, *correction, *kept;
    int64_t *rows, *window, *some;
    tile_t tile;
} search_t;

INLINE double size_of(const double *v) {
    double size = fmax(fmax(fabs(v[0]), fabs(v[1])), fabs(v[2]));
    return v[0] != v[0] || v[1] != v[1] || v[2] != v[2] ? INFINITY : size;
}

/* Write those rows of a list that are within reach of some of them; both lists are increasing. */
static index_t around(const int64_t *some, index_t found, const int64_t *rows, index_t count,
                      int64_t *near) {
    index_t next = 0, kept = 0;
    for (index_t i = 0; i < count; i++) {
        int64_t row = rows[i];
        while (next < found && some[next] < row - REACH)
            next++;
        if (next < found && some[next] <= row + REACH)
            near[kept++] = row;
    }
    return kept;
}

/* Improve the increments of the first rows in the list until corrections are small enough, and
 * return how many rows are in the way, which are listed then; -1 if there is no end to it. */
static index_t newton(search_t *search, matrix_t unknown, double scale, index_t count,
                      double enough) {
    double limit = LARGEST_FIRST, before = INFINITY;
    for (index_t step = 0; step < MOST_STEPS; step++) {
        double size = step_of(search->equations, scale, unknown, (indices_t){search->rows, count},
                              (matrix_t){0}, search->correction, search->kept, &search->tile);
        index_t bad = 0, moving = 0;
        if (!(size <= limit))
            for (index_t i = 0; i < count; i++) {
                search->some[bad] = search->rows[i];
                bad += !(size_of(search->correction + 3 * i) <= limit);
            }
        for (index_t i = 0; i < count; i++) {
            double *w = row_of(unknown, search->rows[i]);
            const double *d = search->correction + 3 * i;
            w[0] += d[0], w[1] += d[1], w[2] += d[2];
        }
        if (bad)
            return bad;
        if (size <= ROUNDING && size > 0.5 * before)
            return 0;
        for (index_t i = 0; i < count; i++) {
            search->some[moving] = search->rows[i];
            moving += !(size_of(search->correction + 3 * i) <= enough);
        }
        if (!moving)
            return 0;
        count = around(search->some, moving, search->rows, count, search->rows);
        limit = fmax(CONTRACTION * size, ROUNDING);
        before = size;
    }
    return -1;
}

/* Carry the increments of a window of rows from where nothing turns to the full scale, those beyond
 * it following by themselves, and return whether that was possible. */
static bool march(search_t *search, index_t count) {
    matrix_t trial = {search->trial, search->here.n, 3};
    double scale = 0.0, growth = 0.5, reached[2] = {0.0, 0.0};
    index_t points = 0;
    /* w(s) = s w' + s^2 (c + s d), from what it is at the last one or two scales. */
    for (index_t row = 0; row < trial.n; row++)
        for (index_t k = 0; k < 3; k++)
            search->bend[3 * row + k] = row_of(search->here, row)[k]
                                      - row_of(search->tangent, row)[k];
    for (index_t i = 0; i < count; i++)
        put_vec(search->bend + 3 * search->window[i], vec(0.0, 0.0, 0.0));
    memcpy(search->bend_before, search->bend, sizeof(double) * 3 * (size_t)trial.n);
    while (scale < 1.0) {
        double next = fmin(1.0, scale + growth);
        double ahead = points == 2 ? (next - reached[0]) / (reached[0] - reached[1]) : 0.0;
        for (index_t k = 0; k < 3 * trial.n; k++) {
            double bend = search->bend[k] + ahead * (search->bend[k] - search->bend_before[k]);
            trial.v[k] = next * (search->tangent.v[k] + next * bend);
        }
        memcpy(search->rows, search->window, sizeof *search->rows * (size_t)count);
        if (newton(search, trial, next, count, ON_THE_WAY)) {
            growth *= 0.5;
            if (growth < SMALLEST_GROWTH)
                return false;
            continue;
        }
        for (index_t i = 0; i < count; i++)
            for (index_t k = 3 * search->window[i]; k < 3 * search->window[i] + 3; k++) {
                search->bend_before[k] = search->bend[k];
                search->bend[k] = (trial.v[k] / next - search->tangent.v[k]) / next;
            }
        points = least(points + 1, 2);
        reached[1] = reached[0], reached[0] = next;
        growth = 2.0 * (next - scale);
        scale = next;
    }
    for (index_t i = 0; i < count; i++)
        put_vec(row_of(search->here, search->window[i]),
                vec_at(row_of(trial, search->window[i])));
    return true;
}

/* Newton's method from the increments of Euclidean space straight to the full steps.  Rows in the way
 * are carried there in smaller steps: a correction decays by 0.27 with each keyframe, so the others
 * hardly take notice.  The solution is the one connected with small rotations. */
static bool search_increments(search_t *search) {
    index_t count = search->here.n;
    for (index_t attempt = 0;; attempt++) {
        for (index_t i = 0; i < count; i++)
            search->rows[i] = i;
        index_t bad = newton(search, search->here, 1.0, count, SETTLED);
        if (bad <= 0 || attempt == MOST_ATTEMPTS)
            return bad == 0;
        for (index_t i = 0; i < count; i++)
            search->rows[i] = i;
        index_t width = around(search->some, bad, search->rows, count, search->window);
        if (attempt || width > count / 2) {
            memcpy(search->window, search->rows, sizeof *search->rows * (size_t)count);
            width = count;
        }
        if (!march(search, width))
            return false;
    }
}

/* The only unknown, where two increments are known at both ends: a logarithm, the principal one as
 * in the Hermite curve.  Whole turns added to the step are left to the search. */
static bool is_explicit(const equations_t *equations) {
    return equations->steps.n == 1 && equations->heads.n == 2 && equations->tails.n == 2
        && norm(vec_at(equations->steps.v)) <= M_PI;
}

int find_increments(const equations_t *equations, matrix_t unknown) {
    if (is_explicit(equations)) {
        put_vec(unknown.v, end_step(equations, 1.0, 0));
        return FOUND;
    }
    size_t count = (size_t)equations->steps.n;
    int found = OUT_OF_MEMORY;
    search_t *search = malloc(sizeof *search);
    int64_t *lists = malloc(3 * count * sizeof *lists);
    double *memory = malloc((15 * count + KEPT * (PIECE + HALO)) * sizeof *memory);
    if (search && lists && memory) {
        search->equations = equations;
        search->tangent = (matrix_t){memory, unknown.n, 3}, search->here = unknown;
        search->bend = memory + 3 * count, search->bend_before = memory + 6 * count;
        search->trial = memory + 9 * count, search->correction = memory + 12 * count;
        search->kept = memory + 15 * count;
        search->rows = lists, search->window = lists + count, search->some = lists + 2 * count;
        found = euclidean_increments(equations, search->tangent);
    }
    if (found == FOUND) {
        memcpy(unknown.v, search->tangent.v, 3 * count * sizeof(double));
        found = search_increments(search) ? FOUND : NOT_FOUND;
    }
    free(search);
    free(lists);
    free(memory);
    return found;
}
