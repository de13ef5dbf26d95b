/* The largest safe brake rate: how fast a motion may be slowed down on its own path.
 *
 * orientd.planner.certify.brake has the inequalities.  Both are quadratic in the rate, P x^2 + 2 H x <= R,
 * at each of some rates sigma of the path, the nodes.
 */
#include <math.h>
#include <stdlib.h>

#include "differences.h"

/* What is known of some points of a path, each a setpoint before the last one of its differences, at
 * any phase of the setpoints.
 *
 * speed: bound of the velocity around.
 * size: bound of the acceleration that the device sees at any rate of the path.
 * bend: bound of the path's own: what is seen at a rate is at most its square times that.
 * full, twist, step: what is seen is also at most its square times a sum: the bound at the rate 1, and
 *     the shares that the jerk and the steps of the acceleration can add at a lower one.
 * along, jerk: the largest product of velocity and acceleration of the norm, without its sign, and the
 *     largest jerk, as found at the phases.
 * bound: a rate that the acceleration allows, whatever the directions are. */
typedef struct {
    double *speed, *size, *bend, *along, *jerk, *full, *twist, *step, *bound;
    index_t n;
} points_t;

/* The root in the form that does not cancel. */
INLINE double root(double rest, double half, double leading) {
    rest = larger(rest, 0.0);
    double divisor = half + sqrt(half * half + leading * rest);
    return divisor > 0.0 ? rest / divisor : INFINITY;
}

/* The acceleration that is seen at a node of the law, and its product with the velocity. */
typedef struct { double sigma, g, seen, along; } node_t;

INLINE node_t node_at(points_t at, index_t i, brake_law_t law, index_t k) {
    double sigma = law.nodes.v[k], square = sigma * sigma;
    double more = (1.0 - sigma) * (at.twist[i] + at.step[i] / (1.0 + sigma));
    double seen = smaller(at.size[i], square * smaller(at.bend[i], at.full[i] + more));
    return (node_t){sigma, law.nodes.v[law.nodes.m + k], seen,
                    smaller(square * at.along[i], seen * at.speed[i])};
}

/* Return whether a rate is safe at a point. */
static bool allows(points_t at, index_t i, double most, double most_jerk, brake_law_t law, double rate) {
    double speed = at.speed[i], jerk = at.jerk[i], x = rate / law.margin, turn = x * speed;
    index_t broken = !(at.size[i] <= most) | !(jerk <= most_jerk);
    INDEPENDENT
    for (index_t k = 0; k < law.nodes.m; k++) {
        node_t node = node_at(at, i, law, k);
        double change = node.g * turn, bend = node.sigma > 0.0 ? node.seen / node.sigma : 0.0;
        double square = node.seen * node.seen + 2.0 * x * node.g * node.along + change * change;
        double twist = node.sigma * node.sigma * jerk + 3.0 * x * node.g * bend + 4.0 * x * turn;
        broken += (square > most * most) | (twist > most_jerk);
    }
    return !broken;
}

/* Return the largest safe rate of a point. */
static double safe_rate(points_t at, index_t i, double most, double most_jerk, brake_law_t law) {
    double speed = at.speed[i], jerk = at.jerk[i];
    if (at.size[i] > most || jerk > most_jerk)
        return 0.0;
    double rate = law.fastest / law.margin;
    for (index_t k = 0; k < law.nodes.m; k++) {
        node_t node = node_at(at, i, law, k);
        if (most < INFINITY) {
            double turn = node.g * speed;
            rate = smaller(rate, root(most * most - node.seen * node.seen, node.g * node.along,
                                      turn * turn));
        }
        if (most_jerk < INFINITY) {
            double bend = node.sigma > 0.0 ? node.seen / node.sigma : 0.0;
            rate = smaller(rate, root(most_jerk - node.sigma * node.sigma * jerk,
                                      1.5 * node.g * bend, 4.0 * speed));
        }
    }
    return law.margin * rate;
}

/* Write the rates that the acceleration allows.  With velocity and acceleration along each other
 * and y = x speed / A the condition is (1 - r) sigma^2 + y g <= 1, whose largest y is a function
 * of the reserve r alone. */
static void put_bounds(points_t at, double most, row_t worst) {
    const double *restrict table = worst.v, *restrict speed = at.speed, *restrict bend = at.bend;
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
        double place = smaller(sqrt(larger(1.0 - bend[i] * scale, 0.0)), 1.0) * cells;
        int cell = (int)place;
        cell = cell < cells ? cell : cells - 1;
        double allowed = most * (table[cell] + (place - cell) * (table[cell + 1] - table[cell]));
        double rate = speed[i] > 0.0 ? allowed / speed[i] : INFINITY;
        bound[i] = bend[i] <= most ? rate : 0.0;
    }
}

INLINE bool is_at_risk(points_t at, index_t i, double rate, double most_jerk, double most_change) {
    double bend = most_change * at.bend[i] * rate, turn = 4.0 * at.speed[i] * rate * rate;
    return !(at.bound[i] >= rate) | !(at.jerk[i] + bend + turn <= most_jerk);
}

bool is_risky(const double bounds[12], double period, const measure_t *how, double rate) {
    double u = 1.0 / period, bound;
    for (int column = how->first; column < how->end; column++) {
        double speed = u * bounds[column], bend = u * u * bounds[4 + column];
        double jerk = u * u * u * bounds[8 + column];
        points_t at = {.speed = &speed, .bend = &bend, .jerk = &jerk, .bound = &bound, .n = 1};
        put_bounds(at, how->tolerance * row_of(how->limits, 1)[column], how->law.worst);
        double most_jerk = how->limits.n < 3 ? INFINITY : row_of(how->limits, 2)[column];
        if (!(bend < INFINITY && jerk < INFINITY)
            || is_at_risk(at, 0, rate, how->tolerance * most_jerk, how->law.most_change))
            return true;
    }
    return false;
}

/* The differences of a column that a brake rate must suit. */
typedef struct {
    const sight_t *sight;
    double period, most, most_jerk;
    int column;
    index_t orders;
} braking_t;

/* The differences of an order that end at the setpoint of a point begin behind this record. */
INLINE index_t window_of(index_t point, index_t order) { return point + HISTORY - order; }

/* The velocity at the setpoint between the two first differences that make a second one, by phase. */
INLINE vec_t velocity_at(const sight_t *sight, int phase, index_t point) {
    const lanes_t *rates = sight->rates[phase];
    return minus(at(rates, window_of(point, 1)), times(0.5, at(rates + 1, window_of(point, 2))));
}

/* Write what is known of all points: where the path between the records is known, what its own velocity
 * and acceleration are at most, else the differences on the records; and the jerk at the phases. */
INLINE void put_points(const braking_t *b, int column, points_t to) {
    const sight_t *sight = b->sight;
    double u = 1.0 / b->period, u2 = u * u, u3 = u2 * u;
    index_t begin = least(sight->first, to.n), end = most(begin, least(sight->windows[2], to.n));
    INDEPENDENT
    for (index_t i = 0; i < to.n; i++) {
        to.speed[i] = u * size_of(velocity_at(sight, 0, i), column);
        to.bend[i] = u2 * size_of(at(&sight->rates[0][1], window_of(i, 2)), column);
        to.jerk[i] = size_of(at(&sight->rates[0][2], i), column);
    }
    for (int p = 1; p < PHASES; p++)
        INDEPENDENT
        for (index_t i = begin; i < end; i++)
            to.jerk[i] = larger(to.jerk[i], size_of(at(&sight->rates[p][2], i), column));
    INDEPENDENT
    for (index_t i = 0; i < to.n; i++)
        to.jerk[i] *= b->orders < 3 ? 0.0 : u3;
    INDEPENDENT
    for (index_t i = begin; i < end; i++) {
        reach_t bend = reach_of(&sight->segments, window_of(i, 2), 2, column);
        to.speed[i] = u * peak_of(&sight->segments, window_of(i, 1), 1, column);
        to.bend[i] = u2 * reach_at(bend, 2, 1.0);
    }
}

/* Return the least bound that is known of a second difference at any rate, or a given one. */
static double closer(const braking_t *b, index_t i, double crude) {
    const sight_t *sight = b->sight;
    if (i < sight->first || i >= sight->windows[1])
        return crude;
    double bound = sight->proven[4 + b->column][i];
    if (grows(sight, i, 2, b->column))
        bound = smaller(bound, hull_behind(sight, i, 2, b->column));
    return smaller(crude, bound / (b->period * b->period));
}

/* Write how the acceleration that is seen depends on the rate.
 *
 * A second difference is the mean of the acceleration, weighted by a hat as wide as the rate sigma on
 * each side.  From the rate 1 on the mean changes by at most 1 - sigma times a third of the jerk, and
 * times 1 / (2 + 2 sigma) of each step. */
static void put_changes(const braking_t *b, index_t i, points_t to) {
    const sight_t *sight = b->sight;
    double unit = 1.0 / (b->period * b->period), most_jerk = 0.0;
    to.full[i] = to.bend[i], to.twist[i] = to.step[i] = 0.0;
    if (i < sight->first || i >= sight->windows[2])
        return;
    index_t window = window_of(i, 2);
    reach_t reach = reach_of(&sight->segments, window, 2, b->column);
    for (index_t k = window; k <= window + 2; k++)
        most_jerk = larger(most_jerk, peak_of_jerk(&sight->segments, k, b->column));
    to.full[i] = unit * (hull_behind(sight, window, 2, b->column) + 2.0 * reach.off);
    to.twist[i] = unit * most_jerk / 3.0, to.step[i] = 0.5 * unit * reach.steps;
}

/* Return the largest product of velocity and acceleration, without its sign, at the phases. */
static double along_at(const sight_t *sight, index_t i, double period) {
    double along = 0.0, unit = 1.0 / (period * period * period);
    for (int p = 0; p < (i < sight->windows[2] && i >= sight->first ? PHASES : 1); p++)
        along = larger(along, fabs(dot(velocity_at(sight, p, i),
                                       at(sight->rates[p] + 1, window_of(i, 2)))));
    return unit * along;
}

/* Look at a point more closely, which might set the rate. */
static void look_at(const braking_t *b, index_t i, points_t to) {
    index_t window = window_of(i, 2);
    /* At a rate below 1 the difference around this place may end in the period before. */
    to.size[i] = larger(closer(b, window, to.bend[i]),
                        closer(b, most(window - 1, 0), to.bend[i]));
    put_changes(b, i, to);
    to.along[i] = b->column ? INFINITY : along_at(b->sight, i, b->period);
}

/* Lower the brake rate to the least that is safe for a column.
 *
 * first: the record at which the first setpoint is. */
static void brake_column(const braking_t *b, points_t at, brake_law_t law, index_t first,
                         extremes_t *found) {
    if (b->column == 0)
        put_points(b, 0, at);
    else
        put_points(b, b->column, at);
    put_bounds(at, b->most, law.worst);
    /* The point nearest to its limit first; most others are ruled out by it. */
    index_t nearest = 0;
    for (index_t i = 1; i < at.n; i++)
        nearest = at.bound[i] < at.bound[nearest] ? i : nearest;
    for (index_t turn = -1; turn < at.n; turn++) {
        index_t i = turn < 0 ? nearest : turn;
        if (!is_at_risk(at, i, found->rate, b->most_jerk, law.most_change))
            continue;
        look_at(b, i, at);
        if (turn >= 0 && allows(at, i, b->most, b->most_jerk, law, found->rate))
            continue;
        double rate = safe_rate(at, i, b->most, b->most_jerk, law);
        if (rate < found->rate)
            found->rate = rate, found->rate_place = (double)(first + HISTORY + i);
    }
}

void brake(const block_t *block, const sight_t *sight, double period, const measure_t *how,
           extremes_t *found) {
    lane_t rows[9];
    points_t at = {rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7], rows[8],
                   most(sight->counts[2], 0)};
    for (int column = how->first; column < how->end && at.n; column++) {
        double jerk = how->limits.n < 3 ? INFINITY : row_of(how->limits, 2)[column];
        braking_t b = {sight, period, how->tolerance * row_of(how->limits, 1)[column],
                       how->tolerance * jerk, column, how->limits.n};
        brake_column(&b, at, how->law, block->first, found);
    }
}
