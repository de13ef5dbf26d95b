/* Trajectories of products, and retimed by a clock, whose derivatives are known; see trajectory.h. */
#include <float.h>
#include <math.h>

#include "clock.h"
#include "sampling.h"
#include "trajectory.h"

enum { CHECKS = 3, POINTS = NODES + CHECKS };

/* The Lobatto nodes -cos(pi i / 9), and points where what is left out shows most: between the
 * outermost two and in the middle. */
static const double PLACES[POINTS] = {
    -1.0, -0.9396926207859084, -0.766044443118978, -0.5, -0.17364817766693036,
    0.17364817766693036, 0.5, 0.766044443118978, 0.9396926207859084, 1.0,
    -0.984807753012208, 0.0, 0.984807753012208,
};
enum { MIDDLE = NODES + 1 };

/* Largest error of a piece at these points, as a share of the length that r covers on it. */
#define MISSED 1e-13
/* Rad, that rotation vectors between two orientations may be off by rounding. */
#define ROUNDING 1e-14
/* Rad, an error that is never taken for rounding, and how much halving lessens others at least. */
#define COARSE 2e-14
#define GAIN 8.0
/* By which a derivative by u at an end may be off, as a share of the first one; the second one also for each rad beyond many
 * turns of the half angles it is of, whose rounding it would spread along the piece. */
#define MANY_TURNS 60.0
#define LAST_DIGIT 2e-15
#define LAST_DIGITS 1e-12
/* Share of an element within which instants are the same. */
#define SAME 1e-9

/* Where pieces are written. */
typedef struct { row_t breaks; matrix_t pieces; index_t count; } table_t;

/* The values that a piece must meet: its base, rotation vectors at the points and their first two
 * derivatives by u at both ends.  The rotation vector at u = 0 is subtracted, so the others keep all
 * their digits.
 *
 * rounding: largest rounding error of the rotation vectors, rad.
 * negligible: the piece omits last coefficients up to this size, rad.
 * slight: largest error of a second derivative at an end. */
typedef struct {
    quat_t base;
    vec_t middle, r[POINTS], rates[2], changes[2];
    double rounding, negligible, slight;
} wanted_t;

/* Gives what is wanted between two instants; false if r goes too far. */
typedef bool source_t(const void *from, double begin, double end, wanted_t *wanted);

INLINE double apart(vec_t a, vec_t b) {
    return fmax(fabs(a.x - b.x), fmax(fabs(a.y - b.y), fabs(a.z - b.z)));
}

/* Polynomials that have all derivatives up to the second 0 at both ends, but the first or the
 * second one 1 at u = 1. */
static const double BENT[2][7] = {
    {-0.0625, -0.1875, -0.125, 0.125, 0.1875, 0.0625, 0.0},
    {0.03125, 0.0625, -0.03125, -0.125, -0.03125, 0.0625, 0.03125},
};

/* Set a derivative at an end, u = 1 or -1, to the wanted value.  Lower derivatives stay. */
static void pin(double *c, int order, double end, vec_t wanted, double slight) {
    vec_t missed = wanted;
    for (int j = DEGREE; j >= order; j--) {
        double factor = order == 1 ? j : j * (j - 1.0);
        missed = scaled_plus((j - order) % 2 ? -end * factor : -factor, vec_at(c + 3 * j), missed);
    }
    if (!(norm(missed) > slight))
        return;
    for (int j = 0; j < 7; j++) {
        double shape = (j + order) % 2 ? end * BENT[order - 1][j] : BENT[order - 1][j];
        put_vec(c + 3 * j, scaled_plus(shape, missed, vec_at(c + 3 * j)));
    }
}

/* Append pieces from one instant to another, halved until they fit or that does not help, which
 * leaves rounding.
 *
 * before: what twice as long a piece missed, rad. */
static bool append(table_t *table, source_t *source, const void *from, double begin, double end,
                   double before) {
    wanted_t wanted;
    double missed = INFINITY;
    if (table->count == table->pieces.n)
        return false;
    double *piece = row_of(table->pieces, table->count), *c = piece + 4;
    bool fits = source(from, begin, end, &wanted);
    if (fits) {
        double far = 0.0;
        missed = 0.0;
        /* Signs are continuous: bases are at most 2 rad apart, so their quaternions at most 1. */
        bool is_other = table->count && square_apart(quat_at(piece - PIECE), wanted.base, 1.0) > 2.0;
        put_quat(piece, is_other ? opposite(wanted.base) : wanted.base);
        for (int i = 0; i < NODES; i++)
            far = fmax(far, apart(wanted.r[i], vec(0.0, 0.0, 0.0)));
        put_polynomial(wanted.r, 1e-16 * far + wanted.negligible, c);
        for (int side = 0; side < 2; side++) {
            pin(c, 1, 2.0 * side - 1.0, wanted.rates[side], LAST_DIGIT * norm(wanted.rates[side]));
            pin(c, 2, 2.0 * side - 1.0, wanted.changes[side],
                wanted.slight + LAST_DIGIT * norm(wanted.rates[side]));
        }
        for (int i = NODES; i < POINTS; i++)
            missed = fmax(missed, apart(polynomial_at(c, PLACES[i]), wanted.r[i]));
        fits = missed <= MISSED * far + wanted.rounding
            || (missed <= COARSE + 8.0 * wanted.rounding && missed * GAIN >= before);
        put_vec(c, plus(vec_at(c), wanted.middle));
    }
    double middle = 0.5 * (begin + end);
    if (!fits && begin < middle && middle < end)
        return append(table, source, from, begin, middle, missed)
            && append(table, source, from, middle, end, missed);
    table->breaks.v[++table->count] = end;
    return true;
}

/* Products. */

typedef struct { const product_t *product; const double *given; index_t span; } factors_t;

/* Coefficients of k = (1 - (|r| / 2) cot(|r| / 2)) / |r|^2 by |r|^2. */
static const double INVERSE[] = {
    1.0 / 12, 1.0 / 720, 1.0 / 30240, 1.0 / 1209600, 1.0 / 47900160, 691.0 / 1307674368000,
    1.0 / 74724249600, 3617.0 / 10670622842880000, 43867.0 / 5109094217170944000,
    174611.0 / 802857662698291200000.0,
};

/* The inverse of the right Jacobian, v + r x v / 2 + k r x (r x v) (Sola et al., 2018, eq. 144). */
void put_rates(vec_t r, vec_t omega, vec_t alpha, double half, vec_t *rate, vec_t *change) {
    double x = dot(r, r), k = 0.0, by_x = 0.0;
    for (int j = sizeof INVERSE / sizeof *INVERSE - 1; j >= 0; j--) {
        by_x = fused(x, by_x, k);
        k = fused(x, k, INVERSE[j]);
    }
    vec_t once = cross(r, omega), twice = cross(r, once);
    vec_t by_time = plus(omega, plus(times(0.5, once), times(k, twice)));
    vec_t turn = cross(r, alpha), bend = cross(by_time, omega);
    vec_t second = plus(alpha, plus(times(0.5, turn), times(k, cross(r, turn))));
    second = plus(second, plus(times(0.5, bend), times(2.0 * by_x * dot(r, by_time), twice)));
    second = plus(second, times(k, plus(cross(by_time, once), cross(r, bend))));
    *rate = times(half, by_time);
    *change = times(half * half, second);
}

static bool of_product(const void *from, double begin, double end, wanted_t *wanted) {
    const factors_t *of = from;
    const product_t *product = of->product;
    row_t breaks = product->breaks;
    double u[LANES], start = breaks.v[of->span], width = breaks.v[of->span + 1] - start;
    motions_t at;
    for (int i = 0; i < LANES; i++) {
        double share = 0.5 * (1.0 + PLACES[least(i, POINTS - 1)]);
        u[i] = fmin((begin - start + share * (end - begin)) / width, 1.0);
    }
    product_at(product, of->span, u, &at);
    double length_of_all = 0.0;
    bool is_near = true;
    wanted->base = motion_of(&at, MIDDLE).q, wanted->middle = vec(0.0, 0.0, 0.0);
    wanted->rounding = ROUNDING, wanted->slight = 0.0, wanted->negligible = 2e-16;
    index_t first = product->first.n ? product->first.v[of->span] : of->span;
    for (index_t k = 0; k < product->values.m; k++) {  /* angles of many turns have fewer digits */
        double length = norm(vec_at(row_of(product->increments, first + k)));
        wanted->rounding += 4.0 * DBL_EPSILON * length;
        length_of_all += length;
        wanted->negligible += DBL_EPSILON * length;
    }
    wanted->slight += LAST_DIGITS * fmax(length_of_all - MANY_TURNS, 0.0);
    for (int i = 0; i < POINTS; i++) {
        wanted->r[i] = rotation_vector(wanted->base, motion_of(&at, i).q);
        is_near &= norm(wanted->r[i]) <= LONGEST_TURN;
    }
    for (int side = 0; side < 2; side++) {
        int i = side * (NODES - 1);
        motion_t state = motion_of(&at, i);
        const double *given = of->given + 6 * side;
        bool is_end = side ? end == breaks.v[breaks.n - 1] : begin == breaks.v[0];
        if (is_end && !isnan(given[0]))
            state.omega = vec_at(given);
        if (is_end && !isnan(given[3]))
            state.alpha = vec_at(given + 3);
        put_rates(wanted->r[i], state.omega, state.alpha, 0.5 * (end - begin),
                  &wanted->rates[side], &wanted->changes[side]);
    }
    return is_near;
}

index_t product_trajectory(const product_t *product, const double *given, index_t cuts,
                           row_t ends, matrix_t pieces) {
    table_t table = {ends, pieces, 0};
    row_t breaks = product->breaks;
    ends.v[0] = breaks.v[0];
    for (index_t span = 0; span + 1 < breaks.n; span++) {
        factors_t from = {product, given, span};
        double begin = breaks.v[span], width = breaks.v[span + 1] - begin;
        for (index_t k = 0; k < cuts; k++) {
            double start = table.breaks.v[table.count];
            double end = k + 1 < cuts ? begin + width * (double)(k + 1) / (double)cuts
                                      : breaks.v[span + 1];
            if (!append(&table, of_product, &from, start, end, INFINITY))
                return 0;
        }
    }
    return table.count;
}

/* Build a trajectory with the timing of a clock. */

typedef struct {
    const clocked_t *clock;
    index_t element;
    double first, begin, end;  /* of the trajectory, and of the piece */
    const double *piece;
} retimed_t;

static bool of_clock(const void *from, double begin, double end, wanted_t *wanted) {
    const retimed_t *of = from;
    pace_t paces[POINTS];
    double per_second = 2.0 / (of->end - of->begin), half = 0.5 * (end - begin);
    double middle = put_paces(of->clock, of->element, begin, end, PLACES, POINTS, paces);
    double u = (of->first + middle - of->begin) * per_second - 1.0;
    /* The polynomial about u: what changes along the piece keeps all its digits. */
    double c[3 * NODES];
    for (int j = 0; j < 3 * NODES; j++)
        c[j] = of->piece[4 + j];
    for (int k = 0; k < DEGREE; k++)
        for (int j = DEGREE - 1; j >= k; j--)
            for (int axis = 0; axis < 3; axis++)
                c[3 * j + axis] = fused(u, c[3 * j + 3 + axis], c[3 * j + axis]);
    wanted->base = quat_at(of->piece), wanted->middle = vec_at(c), wanted->slight = 0.0;
    wanted->rounding = 4e-16 * per_second * (of->first + middle) * norm(vec_at(c + 3));
    wanted->negligible = 0.02 * wanted->rounding;
    put_vec(c, vec(0.0, 0.0, 0.0));
    double v[LANES], r[3][LANES];
    for (int i = 0; i < LANES; i++)
        v[i] = per_second * paces[least(i, POINTS - 1)].s;
    for (int axis = 0; axis < 3; axis++) {
        for (int i = 0; i < LANES; i++)
            r[axis][i] = c[3 * DEGREE + axis];
        for (int j = DEGREE - 1; j >= 0; j--)
            for (int i = 0; i < LANES; i++)
                r[axis][i] = fused(v[i], r[axis][i], c[3 * j + axis]);
    }
    for (int i = 0; i < POINTS; i++)
        wanted->r[i] = vec(r[0][i], r[1][i], r[2][i]);
    for (int side = 0; side < 2; side++) {
        pace_t pace = paces[side * (NODES - 1)];
        double v = per_second * pace.s, rate = half * per_second * pace.rate;
        vec_t first = vec(0.0, 0.0, 0.0), second = first;
        for (int j = DEGREE; j > 0; j--) {
            second = scaled_plus(v, second, first);
            first = scaled_plus(v, first, times(j, vec_at(c + 3 * j)));
        }
        wanted->rates[side] = times(rate, first);
        wanted->changes[side] = plus(times(rate * rate, second),
                                     times(half * half * per_second * pace.change, first));
    }
    return true;
}

index_t retime_trajectory(row_t breaks, matrix_t pieces, const clocked_t *clock, row_t ends,
                          matrix_t out) {
    table_t table = {ends, out, 0};
    double first = breaks.v[0];
    index_t k = 0;
    ends.v[0] = clock->times.v[0];
    double next = time_of(clock, breaks.v[1] - first);
    for (index_t e = 0; e + 1 < clock->times.n; e++) {
        double begin = clock->times.v[e], stop = clock->times.v[e + 1];
        double same = SAME * (stop - begin), since = begin;
        while (k + 1 < pieces.n && next < stop - same) {
            if (next > since + same) {
                retimed_t from = {clock, e, first, breaks.v[k], breaks.v[k + 1], row_of(pieces, k)};
                if (!append(&table, of_clock, &from, since, next, INFINITY))
                    return 0;
                since = next;
            }
            k++;
            next = time_of(clock, breaks.v[k + 1] - first);
        }
        retimed_t from = {clock, e, first, breaks.v[k], breaks.v[k + 1], row_of(pieces, k)};
        if (!append(&table, of_clock, &from, since, stop, INFINITY))
            return 0;
    }
    return table.count;
}
