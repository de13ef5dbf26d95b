/* Newton steps of the equations of an interpolating cumulative B-spline.
 *
 * Equations are linearised eight side by side in the vector units, and eliminated one after the other
 * as a matrix of blocks of 3 x 3.  Blocks are not exchanged for pivots: the collocation matrix of a
 * B-spline needs none (de Boor, 1978), and Newton's method corrects what it costs elsewhere.
 */
#include <stdlib.h>
#include <string.h>

#include "increments.h"
#include "lane_log.h"
#include "lanes.h"

enum {
    LANES = 8,
    BLOCK = 9,
    MOST_BLOCKS = 2 * MOST_TIES + 1,
    RIGHT = MOST_BLOCKS * BLOCK, /* where the two right sides of a row stand: of step and rate */
    ROW = RIGHT + 6,
};

typedef double lanes_t[LANES];
typedef struct { vec_t x, y, z; } columns_t;

bool new_system(index_t rows, index_t ties, system_t *system) {
    index_t count = rows + 2 * ties, stride = count + 2 * LANES, kept = BLOCK * ties + 6;
    index_t wide = 2 * ties + 4 + 4 + 5;
    double *next = calloc((size_t)(wide * stride + 9 * count + kept * (count + 2 * ties)),
                          sizeof *next);
    *system = (system_t){.rows = rows, .ties = ties, .count = count, .stride = stride};
    if (!next)
        return false;
    system->memory = next;
    system->share = next, next += 2 * ties * stride;
    system->step = next, next += 4 * stride;
    system->target = next, next += 4 * stride;
    system->length = next, next += stride;
    system->inverse = next, next += stride;
    system->axis = next, next += 3 * stride;
    system->w = next, next += 3 * count;
    system->change = next, next += 3 * count;
    system->rate = next, next += 3 * count;
    system->kept = next + kept * ties;
    return true;
}

INLINE columns_t columns_at(const double *v, index_t step) {
    return (columns_t){vec(v[0], v[step], v[2 * step]), vec(v[3 * step], v[4 * step], v[5 * step]),
                       vec(v[6 * step], v[7 * step], v[8 * step])};
}

INLINE vec_t applied(columns_t m, vec_t v) {
    return scaled_plus(v.x, m.x, scaled_plus(v.y, m.y, times(v.z, m.z)));
}

INLINE columns_t less(columns_t a, columns_t m, columns_t b) {
    return (columns_t){minus(a.x, applied(m, b.x)), minus(a.y, applied(m, b.y)),
                       minus(a.z, applied(m, b.z))};
}

/* Lengths and axes of the increments. */
static void put_axes(system_t *system) {
    double *restrict length = system->length, *restrict inverse = system->inverse;
    double *restrict x = system->axis, *restrict y = x + system->stride;
    double *restrict z = y + system->stride;
    const double *restrict w = system->w;
    INDEPENDENT
    for (index_t i = 0; i < system->count; i++) {
        vec_t v = vec_at(w + 3 * i);
        length[i] = norm(v);
        inverse[i] = length[i] > 0.0 ? 1.0 / length[i] : 0.0;
        x[i] = inverse[i] * v.x, y[i] = inverse[i] * v.y, z[i] = inverse[i] * v.z;
    }
}

/* The turn of the first or last interval, with the increments that are settled there taken off. */
static quat_t end_target(const system_t *system, double scale, index_t row) {
    const double *step = system->step + row;
    index_t stride = system->stride;
    vec_t axis = vec(step[stride], step[2 * stride], step[3 * stride]);
    quat_t turn = exponential(times(scale * step[0], axis));
    for (index_t k = 0; row == 0 && k < system->taken[0]; k++)
        turn = multiplied(exponential(times(-scale, system->off[0][k])), turn);
    for (index_t k = 0; row == system->rows - 1 && k < system->taken[1]; k++)
        turn = multiplied(turn, exponential(times(-scale, system->off[1][k])));
    return turn;
}

static void put_targets(system_t *system, double scale) {
    index_t stride = system->stride, last = system->rows - 1;
    const double *restrict step = system->step;
    double *restrict target = system->target;
    INDEPENDENT
    for (index_t i = 0; i < system->rows; i++) {
        double c, s;
        cosine_and_sine(scale * step[i], &c, &s);
        target[i] = c, target[stride + i] = s * step[stride + i];
        target[2 * stride + i] = s * step[2 * stride + i];
        target[3 * stride + i] = s * step[3 * stride + i];
    }
    for (index_t end = 0; end < 2; end++) {
        index_t row = end ? last : 0;
        quat_t q = end_target(system, scale, row);
        double *to = target + row;
        to[0] = q.w, to[stride] = q.x, to[2 * stride] = q.y, to[3 * stride] = q.z;
    }
}

/* Put a factor before the product of eight rows, and add its derivative to theirs.
 *
 * With P the product of a row and e = log(E^-1 P) its error, a Newton step obeys
 * sum_f R(S_f)^T J_f dw_f = -e, where S_f is the product of the factors after f and J_f the right
 * Jacobian times the share: that of e leaves a multiple of its own axis as it is, so it need not be
 * applied. */
static void put_factor(const system_t *system, index_t place, double base, double sign,
                       const double *restrict share, lanes_t *restrict after,
                       lanes_t *restrict block) {
    const double *restrict length = system->length + place;
    const double *restrict inverse = system->inverse + place;
    const double *restrict x = system->axis + place, *restrict y = x + system->stride;
    const double *restrict z = y + system->stride;
    INDEPENDENT
    for (index_t i = 0; i < LANES; i++) {
        double f = base + sign * share[i], c, s;
        cosine_and_sine(f * length[i], &c, &s);
        vec_t n = vec(x[i], y[i], z[i]), late = vec(after[1][i], after[2][i], after[3][i]);
        /* With the angle t = 2 f |w|: sin(t)/t, (1 - cos t)/t and 1 - sin(t)/t, times f. */
        double scaled = s * inverse[i], along = length[i] > 0.0 ? scaled * c : f;
        vec_t k = times(scaled * s, n), m = times(f - along, n);
        double w = after[0][i];
        vec_t a = turned_back(w, late, vec(m.x * n.x + along, m.x * n.y - k.z, m.x * n.z + k.y));
        vec_t b = turned_back(w, late, vec(m.y * n.x + k.z, m.y * n.y + along, m.y * n.z - k.x));
        vec_t d = turned_back(w, late, vec(m.z * n.x - k.y, m.z * n.y + k.x, m.z * n.z + along));
        block[0][i] += a.x, block[1][i] += a.y, block[2][i] += a.z;
        block[3][i] += b.x, block[4][i] += b.y, block[5][i] += b.z;
        block[6][i] += d.x, block[7][i] += d.y, block[8][i] += d.z;
        quat_t q = multiplied(quat(c, s * n.x, s * n.y, s * n.z), quat(w, late.x, late.y, late.z));
        after[0][i] = q.w, after[1][i] = q.x, after[2][i] = q.y, after[3][i] = q.z;
    }
}

/* Write eight rows from one on. */
static void linearise(const system_t *system, index_t row, lanes_t *restrict to) {
    index_t factors = 2 * system->ties, stride = system->stride;
    const double *share = system->share + row;
    lanes_t after[4];
    memset(to, 0, (size_t)((factors + 1) * BLOCK) * sizeof *to);
    for (index_t i = 0; i < LANES; i++)
        after[0][i] = 1.0, after[1][i] = after[2][i] = after[3][i] = 0.0;
    for (index_t f = factors - 1; f >= 0; f--)
        put_factor(system, row + 1 + f, 0.0, 1.0, share + f * stride + 1, after,
                   to + (1 + f) * BLOCK);
    put_factor(system, row, 1.0, -1.0, share, after, to);
    for (index_t f = 1; f < factors; f++)
        put_factor(system, row + f, 0.0, -1.0, share + f * stride, after, to + f * BLOCK);
    const double *restrict target = system->target + row, *restrict step = system->step + row;
    INDEPENDENT
    for (index_t i = 0; i < LANES; i++) {
        quat_t back = quat(target[i], -target[stride + i], -target[2 * stride + i],
                           -target[3 * stride + i]);
        quat_t q = multiplied(back, quat(after[0][i], after[1][i], after[2][i], after[3][i]));
        vec_t e = lane_logarithm(q, 1.0);
        to[RIGHT][i] = -e.x, to[RIGHT + 1][i] = -e.y, to[RIGHT + 2][i] = -e.z;
        for (index_t k = 0; k < 3; k++)
            to[RIGHT + 3 + k][i] = step[i] * step[(1 + k) * stride + i];
    }
}

/* Eliminate a row: keep what the substitution needs, given what was kept of the rows before.
 *
 * step: between the numbers of the row. */
INLINE void eliminate(const double *row, index_t step, index_t ties, double *kept) {
    index_t size = BLOCK * ties + 6;
    columns_t b[MOST_BLOCKS];
    for (index_t k = 0; k <= 2 * ties; k++)
        b[k] = columns_at(row + k * BLOCK * step, step);
    row += RIGHT * step;
    vec_t e = vec(row[0], row[step], row[2 * step]);
    vec_t r = vec(row[3 * step], row[4 * step], row[5 * step]);
    for (index_t k = 0; k < ties; k++) {
        const double *before = kept - (ties - k) * size;
        for (index_t j = 1; j <= ties; j++)
            b[k + j] = less(b[k + j], b[k], columns_at(before + (j - 1) * BLOCK, 1));
        e = minus(e, applied(b[k], vec_at(before + ties * BLOCK)));
        r = minus(r, applied(b[k], vec_at(before + ties * BLOCK + 3)));
    }
    /* Where the determinant is zero, what comes is not finite, which is looked for at the end. */
    columns_t m = b[ties];
    vec_t p = cross(m.y, m.z), q = cross(m.z, m.x), s = cross(m.x, m.y);
    double inverse = 1.0 / dot(m.x, p);
    p = times(inverse, p), q = times(inverse, q), s = times(inverse, s);
    for (index_t j = 0; j < ties; j++) {
        columns_t c = b[ties + 1 + j];
        double *to = kept + j * BLOCK;
        put_vec(to, vec(dot(p, c.x), dot(q, c.x), dot(s, c.x)));
        put_vec(to + 3, vec(dot(p, c.y), dot(q, c.y), dot(s, c.y)));
        put_vec(to + 6, vec(dot(p, c.z), dot(q, c.z), dot(s, c.z)));
    }
    put_vec(kept + ties * BLOCK, vec(dot(p, e), dot(q, e), dot(s, e)));
    put_vec(kept + ties * BLOCK + 3, vec(dot(p, r), dot(q, r), dot(s, r)));
}

/* Write a condition at an end as a row, and return the square of its error. */
static double put_condition(const system_t *system, double scale, index_t end, index_t place,
                            double *row) {
    index_t ties = system->ties, last = system->count - 1;
    const double *factors = system->at_end[end][place];
    vec_t known = system->known[end][place], error = times(-scale, known);
    memset(row, 0, ROW * sizeof *row);
    for (index_t j = 0; j < OUTERMOST; j++) {
        if (factors[j] == 0.0)
            continue;
        index_t k = ties + (end ? place - j : j - place);
        for (index_t c = 0; c < 3; c++)
            row[k * BLOCK + 4 * c] = factors[j];
        error = scaled_plus(factors[j], vec_at(system->w + 3 * (end ? last - j : j)), error);
    }
    put_vec(row + RIGHT, times(-1.0, error));
    put_vec(row + RIGHT + 3, known);
    return dot(error, error);
}

INLINE double eliminate_all(system_t *system, double scale, index_t ties) {
    index_t size = BLOCK * ties + 6, rows = system->rows;
    double *kept = system->kept, total = 0.0, row[ROW];
    lanes_t tile[ROW];
    for (index_t k = 0; k < ties; k++, kept += size) {
        total += put_condition(system, scale, 0, k, row);
        eliminate(row, 1, ties, kept);
    }
    for (index_t begin = 0; begin < rows; begin += LANES) {
        linearise(system, begin, tile);
        for (index_t i = 0; i < least(LANES, rows - begin); i++, kept += size) {
            index_t place = begin + i;
            if ((place == 0 && system->taken[0]) || (place == rows - 1 && system->taken[1])) {
                const double h = 1e-6;
                quat_t here = end_target(system, scale, place);
                quat_t ahead = end_target(system, scale + h, place);
                vec_t rate = times(1.0 / h, logarithm(relative(here, ahead)));
                tile[RIGHT + 3][i] = rate.x, tile[RIGHT + 4][i] = rate.y;
                tile[RIGHT + 5][i] = rate.z;
            }
            vec_t e = vec(tile[RIGHT][i], tile[RIGHT + 1][i], tile[RIGHT + 2][i]);
            total += dot(e, e);
            eliminate(&tile[0][i], LANES, ties, kept);
        }
    }
    for (index_t k = ties - 1; k >= 0; k--, kept += size) {
        total += put_condition(system, scale, 1, k, row);
        eliminate(row, 1, ties, kept);
    }
    return total;
}

INLINE double substitute_all(system_t *system, index_t ties) {
    index_t size = BLOCK * ties + 6;
    double largest = 0.0, all = 0.0;
    for (index_t i = system->count - 1; i >= 0; i--) {
        const double *kept = system->kept + i * size;
        double *change = system->change + 3 * i, *rate = system->rate + 3 * i;
        vec_t d = vec_at(kept + ties * BLOCK), r = vec_at(kept + ties * BLOCK + 3);
        for (index_t j = 1; j <= ties && i + j < system->count; j++) {
            columns_t c = columns_at(kept + (j - 1) * BLOCK, 1);
            d = minus(d, applied(c, vec_at(change + 3 * j)));
            r = minus(r, applied(c, vec_at(rate + 3 * j)));
        }
        put_vec(change, d), put_vec(rate, r);
        double x = fabs(d.x), y = fabs(d.y), z = fabs(d.z), size_here = x > y ? x : y;
        size_here = z > size_here ? z : size_here;
        largest = size_here > largest ? size_here : largest, all += x + y + z;
    }
    return all < INFINITY ? largest : NAN;
}

double correct(system_t *system, double scale) {
    put_axes(system);
    put_targets(system, scale);
    bool is_narrow = system->ties == 1;
    system->error = is_narrow ? eliminate_all(system, scale, 1) : eliminate_all(system, scale, 2);
    return is_narrow ? substitute_all(system, 1) : substitute_all(system, 2);
}
