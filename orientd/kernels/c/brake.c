/* The largest safe brake rate: how fast a motion may be slowed down on its own path.
 *
 * orientd.planner.certify.brake has the inequalities.  Both are quadratic in the rate, P x^2 + 2 H x <= R,
 * at each of some rates sigma of the path, the nodes.
 */
#include <math.h>
#include <stdlib.h>

#include "differences.h"

#define LOCAL 0.95 /* share of the limit up to which accelerations at records count */

/* Sizes of velocity, acceleration and jerk of some points, the product of the first two without
 * its sign, and a rate that the acceleration allows, whatever the directions are. */
typedef struct { const double *speed, *size, *along, *jerk; double *bound; index_t n; } points_t;

/* The root in the form that does not cancel. */
INLINE double root(double rest, double half, double leading) {
    rest = larger(rest, 0.0);
    double divisor = half + sqrt(half * half + leading * rest);
    return divisor > 0.0 ? rest / divisor : INFINITY;
}

/* Return the largest safe rate of a point. */
static double safe_rate(points_t at, index_t i, double most, double most_jerk, brake_law_t law) {
    double speed = at.speed[i], size = at.size[i], along = at.along[i], jerk = at.jerk[i];
    if (size > most || jerk > most_jerk)
        return 0.0;
    double rate = law.fastest / law.margin;
    const double *sigmas = law.nodes.v, *gs = law.nodes.v + law.nodes.m;
    for (index_t k = 0; k < law.nodes.m; k++) {
        double sigma = sigmas[k], g = gs[k], square = sigma * sigma;
        if (most < INFINITY) {
            double bend = size * square, turn = g * speed;
            rate = smaller(rate, root(most * most - bend * bend, g * square * along, turn * turn));
        }
        if (most_jerk < INFINITY)
            rate = smaller(rate, root(most_jerk - jerk * square, 1.5 * sigma * g * size,
                                   4.0 * speed));
    }
    return law.margin * rate;
}

/* Write the rates that the acceleration allows.  With velocity and acceleration along each other
 * and y = x speed / A the condition is (1 - r) sigma^2 + y g <= 1, whose largest y is a function
 * of the reserve r alone. */
static void put_bounds(points_t at, double most, row_t worst) {
    const double *restrict table = worst.v, *restrict speed = at.speed, *restrict size = at.size;
    double *restrict bound = at.bound;
    double scale = 1.0 / most;
    int cells = (int)worst.n - 1;
    if (!(most < INFINITY)) {
        for (index_t i = 0; i < at.n; i++)
            bound[i] = INFINITY;
        return;
    }
    INDEPENDENT
    for (index_t i = 0; i < at.n; i++) {
        double place = smaller(sqrt(larger(1.0 - size[i] * scale, 0.0)), 1.0) * cells;
        int cell = (int)place;
        cell = cell < cells ? cell : cells - 1;
        double allowed = most * (table[cell] + (place - cell) * (table[cell + 1] - table[cell]));
        double rate = speed[i] > 0.0 ? allowed / speed[i] : INFINITY;
        bound[i] = size[i] <= most ? rate : 0.0;
    }
}

INLINE bool is_at_risk(points_t at, index_t i, double rate, double most_jerk, double most_change) {
    double bend = most_change * at.size[i] * rate, turn = 4.0 * at.speed[i] * rate * rate;
    return (at.bound[i] < rate) | (at.jerk[i] + bend + turn > most_jerk);
}

/* Return the least rate of points, looking closely only at those that could set it. */
static slowest_t least_of(points_t at, double most, double most_jerk, brake_law_t law,
                          index_t shift, slowest_t found) {
    put_bounds(at, most, law.worst);
    index_t risky = 0;
    for (index_t i = 0; i < at.n; i++)
        risky += is_at_risk(at, i, found.rate, most_jerk, law.most_change);
    if (!risky)
        return found;
    /* The point nearest to its limit first; most others are ruled out by it. */
    index_t nearest = 0;
    for (index_t i = 1; i < at.n; i++)
        nearest = at.bound[i] < at.bound[nearest] ? i : nearest;
    for (index_t turn = -1; turn < at.n; turn++) {
        index_t i = turn < 0 ? nearest : turn;
        if (!is_at_risk(at, i, found.rate, most_jerk, law.most_change))
            continue;
        double rate = safe_rate(at, i, most, most_jerk, law);
        if (rate < found.rate)
            found.rate = rate, found.place = shift + i;
    }
    return found;
}

int least_rate(matrix_t velocity, matrix_t acceleration, row_t jerk, double most, double most_jerk,
               brake_law_t law, slowest_t *found) {
    index_t n = jerk.n;
    double *memory = malloc((size_t)(4 * n + 1) * sizeof(double));
    if (memory == NULL)
        return OUT_OF_MEMORY;
    double *speed = memory, *size = speed + n, *along = size + n;
    for (index_t i = 0; i < n; i++) {
        const double *v = row_of(velocity, i), *a = row_of(acceleration, i);
        double vv = 0.0, aa = 0.0, va = 0.0;
        for (index_t k = 0; k < velocity.m; k++)
            vv += v[k] * v[k], aa += a[k] * a[k], va += v[k] * a[k];
        speed[i] = sqrt(vv), size[i] = sqrt(aa), along[i] = fabs(va);
    }
    points_t at = {speed, size, along, jerk.v, along + n, n};
    *found = least_of(at, most, most_jerk, law, 0, (slowest_t){law.fastest, 0});
    free(memory);
    return 0;
}

/* Square of a vector or of one of its components. */
INLINE double square_of(vec_t v, int column) {
    return column == 0 ? dot(v, v) : column == 1 ? v.x * v.x : column == 2 ? v.y * v.y : v.z * v.z;
}

/* Write the largest velocity, acceleration and jerk at the phases of each record, and the largest
 * product of the first two. */
INLINE void put_points(const sight_t *sight, index_t points, double period, int column,
                       lane_t *restrict to) {
    double u = 1.0 / period, u2 = u * u, u3 = u2 * u;
    for (int p = 0; p < PHASES; p++) {
        const lanes_t *rates = sight->rates[p];
        index_t begin = p ? least(sight->first, points) : 0;
        index_t end = p ? least(sight->windows[2], points) : points;
        INDEPENDENT
        for (index_t i = begin; i < end; i++) {
            vec_t v = at(rates, i + 2), a = at(rates + 1, i + 1), j = at(rates + 2, i);
            double along = column == 0 ? fabs(dot(v, a)) : size_of(v, column) * size_of(a, column);
            to[0][i] = larger(p ? to[0][i] : 0.0, square_of(v, column));
            to[1][i] = larger(p ? to[1][i] : 0.0, square_of(a, column));
            to[2][i] = larger(p ? to[2][i] : 0.0, along);
            to[3][i] = larger(p ? to[3][i] : 0.0, square_of(j, column));
        }
    }
    INDEPENDENT
    for (index_t i = 0; i < points; i++) {
        to[0][i] = u * sqrt(to[0][i]), to[1][i] = u2 * sqrt(to[1][i]);
        to[2][i] *= u3, to[3][i] = u3 * sqrt(to[3][i]);
    }
}

/* Take in the accelerations at the records of each difference: the slower a path is passed, the less
 * its differences average.  At full speed these alone count, so that a share of the limit is left. */
static void put_records(const block_t *block, index_t points, int column, double most,
                        lane_t *restrict to) {
    const double (*rows)[BLOCK] = block->rows;
    for (index_t i = 0; i < points; i++)
        for (index_t k = i + 1; k <= i + HISTORY; k++) {
            double size = size_of(vec(rows[7][k], rows[8][k], rows[9][k]), column);
            /* An acceleration of NaN is unknown and counts as zero. */
            size = size < LOCAL * most ? size : isnan(size) ? 0.0 : LOCAL * most;
            to[1][i] = larger(to[1][i], size);
        }
}

/* Take in the least rate of some points, the first of which is that of a record. */
static void note_rate(points_t at, double most, double most_jerk, brake_law_t law, index_t record,
                      extremes_t *found) {
    slowest_t slowest = {found->rate, 0};
    slowest = least_of(at, most, most_jerk, law, 0, slowest);
    if (slowest.rate < found->rate)
        found->rate = slowest.rate, found->rate_place = (double)(record + slowest.place);
}

bool is_risky(const double bounds[12], double period, const measure_t *how, double rate) {
    double u = 1.0 / period, bound;
    for (int column = 0; column < (has_axes(how->limits) ? 4 : 1); column++) {
        double speed = u * bounds[column], size = u * u * bounds[4 + column];
        double jerk = u * u * u * bounds[8 + column], along = speed * size;
        points_t at = {&speed, &size, &along, &jerk, &bound, 1};
        double most = how->tolerance * row_of(how->limits, 1)[column];
        put_bounds(at, most, how->law.worst);
        if (!(size < INFINITY && jerk < INFINITY)
            || is_at_risk(at, 0, rate, how->tolerance * row_of(how->limits, 2)[column],
                          how->law.most_change))
            return true;
    }
    return false;
}

void brake(const block_t *block, const sight_t *sight, double period, const measure_t *how,
           extremes_t *found) {
    index_t points = sight->counts[2];
    if (points <= 0)
        return;
    lane_t rows[5];
    points_t at = {rows[0], rows[1], rows[2], rows[3], rows[4], points};
    double more = how->tolerance;
    /* The norm, then the components where they are limited. */
    for (int column = 0; column < (has_axes(how->limits) ? 4 : 1); column++) {
        if (column == 0)
            put_points(sight, points, period, 0, rows);
        else
            put_points(sight, points, period, column, rows);
        double most = more * row_of(how->limits, 1)[column];
        put_records(block, points, column, most, rows);
        note_rate(at, most, more * row_of(how->limits, 2)[column], how->law,
                  block->first + HISTORY, found);
    }
}

/* Return the largest acceleration of the position at a record, of the periods before and after it;
 * an unknown one counts as zero. */
static double push_at(const block_t *block, double period, index_t i) {
    vec_t speed = at_row(block, MOVING, i);
    double largest = 0.0;
    for (index_t k = i - 1; k <= i; k++) {
        vec_t way = move_at(block, POSITION, k, 0);
        vec_t speeds = plus(times(2.0, speed), at_row(block, MOVING, k < i ? k : k + 1));
        double push = norm(minus(times(3.0 / period, way), speeds));
        largest = isnan(push) ? largest : larger(largest, 2.0 / period * push);
    }
    return largest;
}

/* Speed, acceleration and their product over the phases of a period. */
typedef struct { double speed, size, along; } rates_t;

/* Take in the bounds of a first and a second difference, both cubics of the phase. */
static void take_cubics(const cubic_t *way, const cubic_t *change, double period, int halvings,
                        rates_t *to) {
    if (halvings) {
        cubic_t ways[2], changes[2];
        halve(way, ways, ways + 1), halve(change, changes, changes + 1);
        for (int k = 0; k < 2; k++)
            take_cubics(ways + k, changes + k, period, halvings - 1, to);
        return;
    }
    for (int k = 0; k < 4; k++) {
        vec_t a = times(1.0 / (period * period), change->at[k]);
        /* The velocity at the setpoint between two differences is the mean of both. */
        vec_t v = minus(times(1.0 / period, way->at[k]), times(0.5 * period, a));
        to->speed = larger(to->speed, norm(v)), to->size = larger(to->size, norm(a));
        to->along = larger(to->along, fabs(dot(v, a)));
    }
}

/* Return what counts of the position up to the differences that end at the setpoint after one.
 *
 * begin: the first of these.
 * limit: of the acceleration. */
static rates_t rates_at(const block_t *block, double period, index_t i, index_t begin,
                          int halvings, double limit) {
    cubic_t way, change;
    rates_t rates = {0.0, 0.0, 0.0};
    if (i == begin || !put_cubic(block, period, i, 0, &way)
        || !put_cubic(block, period, i, 1, &change)) {
        vec_t first = move_at(block, POSITION, i, 0), second = move_at(block, POSITION, i, 1);
        way = (cubic_t){{first, first, first, first}};
        change = (cubic_t){{second, second, second, second}};
        halvings = 0;
    }
    take_cubics(&way, &change, period, halvings, &rates);
    for (index_t k = most(i - 1, 1); k <= i + 1 && k + 1 < block->count; k++)
        rates.size = larger(rates.size, smaller(push_at(block, period, k), LOCAL * limit));
    return rates;
}

void brake_moves(const block_t *block, double period, index_t past, const measure_t *how,
                 extremes_t *found) {
    lane_t rows[5] = {{0.0}};
    index_t begin = 1 + past, points = most(block->count - 1 - begin, 0), nearest = 0;
    points_t all = {rows[0], rows[1], rows[2], rows[3], rows[4], points};
    double limit = how->tolerance * how->move_limits.v[1];
    for (index_t k = 0; k < points; k++) {
        rates_t coarse = rates_at(block, period, begin + k, begin, 0, limit);
        rows[0][k] = coarse.speed, rows[1][k] = coarse.size, rows[2][k] = coarse.along;
    }
    put_bounds(all, limit, how->law.worst);
    for (index_t k = 1; k < points; k++)
        nearest = all.bound[k] < all.bound[nearest] ? k : nearest;
    /* The point nearest to its limit first: the coarse bounds of most others rule them out then. */
    for (index_t turn = points ? -1 : 0; turn < points; turn++) {
        index_t k = turn < 0 ? nearest : turn;
        if (!is_at_risk(all, k, found->rate, INFINITY, how->law.most_change))
            continue;
        rates_t close = rates_at(block, period, begin + k, begin, HALVINGS, limit);
        double no_jerk = 0.0, bound;
        points_t at = {&close.speed, &close.size, &close.along, &no_jerk, &bound, 1};
        note_rate(at, limit, INFINITY, how->law, block->first + 1 + begin + k, found);
    }
}
