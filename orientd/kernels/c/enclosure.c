/* Bound a difference for every phase and every rate, by halving of phases and rates.
 *
 * A box of phases and rates is done with once the largest value in it is known to be at most what
 * was looked for, by one of these:
 *
 * - the differences are averages of velocity, acceleration or jerk times a power of the rate;
 * - the value in the middle, and by how much it can change within the box;
 * - it grows with the rate all over the box, so that the highest rate counts alone.  At the rate 1
 *   it is a polynomial of the fourth degree, but for a rest that is bounded, and lies in the hull
 *   of its Bernstein coefficients.
 */
#include "differences.h"

/* Boxes after which a bound is taken as it is. */
enum { BOXES = 50000, STACK = 64 };

/* Below this share of a period a bound is taken as it is, too. */
#define NARROW (1.0 / 512)

typedef struct { double from, to, low, high; } box_t;

/* A difference, and by how much its parts change by phase and by rate. */
typedef struct {
    const block_t *block;
    const segments_t *segments;
    index_t i, order;
    int column;
    reach_t reach;
    double rest, by_phase, by_rate, slope_by_phase, slope_by_rate, bend;
    struct { quat_t q; law_t law; } from[4];  /* the records that it begins behind, and the paths */
} difference_t;

/* A setpoint, and the velocity there unless that is NULL.  Three values are x, y and z. */
INLINE quat_t state_at(const difference_t *d, double place, vec_t *omega) {
    index_t k = most(least((index_t)place - d->i, d->order), 0);
    law_t law = d->from[k].law;
    double c, s, u = place - (double)(d->i + k);
    vec_t turn = law_value(law, u);
    if (!d->block->turns) {
        const quat_t here = d->from[k].q;
        if (omega != NULL)
            *omega = law_rate(law, u);
        return quat(0.0, here.x + turn.x, here.y + turn.y, here.z + turn.z);
    }
    quat_t q = turned_by(d->from[k].q, turn, &c, &s);
    if (omega != NULL)
        *omega = right_jacobian(turn, c, s, law_rate(law, u));
    return q;
}

/* The rotation vector between two setpoints, or the step. */
INLINE vec_t turn_between(bool is_turn, quat_t p, quat_t q) {
    if (!is_turn)
        return vec(q.x - p.x, q.y - p.y, q.z - p.z);
    quat_t turn = relative(p, q);
    double square = (turn.x * turn.x + turn.y * turn.y + turn.z * turn.z) / (turn.w * turn.w);
    if (square < SMALL)
        return times(turn_factor(square) / turn.w, vec(turn.x, turn.y, turn.z));
    return times(2.0, logarithm(shorter(turn)));
}

/* Weights of the first differences in one of an order, and of the setpoints. */
static const double STEP_WEIGHTS[3][3] = {{1, 0, 0}, {1, -1, 0}, {1, -2, 1}};
static const double WEIGHTS[3][4] = {{1, -1, 0, 0}, {1, -2, 1, 0}, {1, -3, 3, -1}};

/* Return the difference at a phase and a rate, and its derivative by the rate unless that is NULL. */
INLINE vec_t difference_at(const difference_t *d, double phase, double rate, vec_t *slope) {
    vec_t value = vec(0, 0, 0), omega, *velocity = slope != NULL ? &omega : NULL;
    if (slope != NULL)
        *slope = vec(0, 0, 0);
    double here = (double)(d->i + d->order) + phase;
    quat_t q = state_at(d, here, NULL);
    for (index_t k = 0; k < d->order; k++) {
        quat_t before = state_at(d, here - (double)(k + 1) * rate, velocity);
        double weight = STEP_WEIGHTS[d->order - 1][k];
        value = plus(value, times(weight, turn_between(d->block->turns, before, q)));
        if (slope != NULL)
            *slope = plus(*slope, times((double)d->order * weight, omega));
        q = before;
    }
    return value;
}

static vec_t value_at(const difference_t *d, double phase) {
    return difference_at(d, phase, 1.0, NULL);
}

static vec_t value_and_slope(const difference_t *d, double phase, double rate, vec_t *slope) {
    return difference_at(d, phase, rate, slope);
}

/* Return a bound of a difference that is not of turns around a phase and below a rate.
 *
 * It is the sum of weighted values at setpoints.  Around its tangent in both directions it changes by
 * no more than half of its second derivatives, which the accelerations at the setpoints bound.
 *
 * value, slope: there, by the rate.
 * width, height: of the phases and the rates. */
static double tangent_bound(const difference_t *d, double phase, double rate, vec_t value,
                            vec_t slope, double width, double height) {
    static const double mixed[3] = {1, 4, 12}, squared[3] = {1, 6, 24}, plain[3] = {2, 4, 8};
    vec_t by_phase = vec(0, 0, 0), velocity;
    index_t n = d->order - 1;
    for (index_t k = 0; k <= d->order; k++) {
        state_at(d, (double)(d->i + d->order) + phase - (double)k * rate, &velocity);
        by_phase = plus(by_phase, times(WEIGHTS[n][k], velocity));
    }
    double half = 0.5 * width, lowest = size_of(minus(value, times(height, slope)), d->column);
    double curved = plain[n] * half * half + 2.0 * mixed[n] * half * height
                  + squared[n] * height * height;
    return larger(size_of(value, d->column), lowest) + half * size_of(by_phase, d->column)
         + 0.5 * d->bend * curved;
}

/* Return a bound over phases at the rate 1 within which no acceleration has a step. */
static double hull_of(const difference_t *d, double from, double to, double *known) {
    vec_t values[PHASE_NODES];
    double largest = 0.0, width = to - from;
    for (index_t n = 0; n < PHASE_NODES; n++) {
        values[n] = value_at(d, from + width * node_of(n));
        *known = larger(*known, size_of(values[n], d->column));
    }
    for (index_t k = 0; k < PHASE_NODES; k++) {
        vec_t sum = vec(0, 0, 0);
        for (index_t n = 0; n < PHASE_NODES; n++)
            sum = plus(sum, times(bernstein(k, n), values[n]));
        largest = larger(largest, size_of(sum, d->column));
    }
    return largest + width * width * d->rest;
}

static double inner(vec_t a, vec_t b, int column) {
    return column == 0 ? dot(a, b) : column == 1 ? a.x * b.x : column == 2 ? a.y * b.y : a.z * b.z;
}

/* Return the place of a step of the acceleration within some phases, or -1 if there is none. */
static double step_within(const difference_t *d, double from, double to) {
    for (index_t k = d->i; k <= d->i + d->order; k++) {
        double place = d->segments->place[k];
        if (d->segments->steps[k] > 0.0 && place > from + 1e-9 && place < to - 1e-9)
            return place;
    }
    return -1.0;
}

static difference_t difference_of(const block_t *block, const segments_t *segments, index_t i,
                                  index_t order, int column) {
    difference_t d = {.block = block, .segments = segments, .i = i, .order = order,
                      .column = column, .reach = reach_of(segments, i, order, column)};
    double w = 0.0, a = 0.0, j = 0.0, change = 0.0, off[3] = {0.0};
    for (index_t k = i; k <= i + order; k++) {
        const double (*rows)[BLOCK] = block->rows;
        d.from[k - i].q = block->turns ? quat(rows[0][k], rows[1][k], rows[2][k], rows[3][k])
                                       : quat(0.0, rows[0][k], rows[1][k], rows[2][k]);
        d.from[k - i].law = law_of(segments, k);
        w = larger(w, peak_of(segments, k, 1, column));
        a = larger(a, peak_of(segments, k, 2, column));
        j = larger(j, peak_of(segments, k, 3, column));
        vec_t jerk = at(&segments->jerk, k);
        change = larger(change, 2.0 * (size_of(at(&segments->spin, k), column)
                                        + segments->spread[k]));
        for (index_t l = i; l < k; l++)
            change = larger(change, size_of(minus(jerk, at(&segments->jerk, l)), column));
    }
    for (index_t k = i; k < i + order; k++) {
        d.rest = larger(d.rest, segments->rest[k]);
        for (index_t l = 0; l < 3; l++)
            off[l] = larger(off[l], segments->coupling[l][k]);
    }
    double steps = d.reach.steps;
    d.bend = a;
    d.rest *= order == 1 ? 1.0 : order == 2 ? 2.0 : 4.0;
    switch (order) {
    case 1:
        d.by_phase = a + off[1], d.by_rate = w;
        d.slope_by_phase = a, d.slope_by_rate = a;
        break;
    case 2:
        d.by_phase = j + steps + 2.0 * off[1], d.by_rate = 2.0 * a;
        d.slope_by_phase = 2.0 * (j + steps), d.slope_by_rate = 2.0 * (a + j + steps);
        break;
    default:
        d.by_phase = 2.0 * change + steps + 2.0 * off[2], d.by_rate = 3.0 * (j + steps);
        d.slope_by_phase = 3.0 * (2.0 * change + steps);
        d.slope_by_rate = 6.0 * j + 6.0 * change + 9.0 * steps;
    }
    d.by_rate += d.reach.slope;
    return d;
}

double enclose(const block_t *block, const segments_t *segments, index_t i, index_t order,
               int column, double hull, double *known, index_t *boxes_left) {
    difference_t d = difference_of(block, segments, i, order, column);
    double bound = *known, low = lowest_rate(d.reach, order, *known);
    box_t boxes[STACK] = {{0.0, 1.0, low, 1.0}};
    int count = 1;
    for (int left = BOXES; count; left--) {
        bool is_spent = --*boxes_left < 0;
        if (is_spent && block->turns)
            return NOT_TIGHT;
        box_t box = boxes[--count];
        double width = box.to - box.from, height = box.high - box.low;
        double middle = box.from + 0.5 * width;
        vec_t slope, value = value_and_slope(&d, middle, box.high, &slope);
        double size = size_of(value, column), climb = size_of(slope, column);
        double turn = 0.5 * width * d.by_phase, spread = turn + height * d.by_rate;
        double lean = 0.5 * width * d.slope_by_phase + height * d.slope_by_rate + d.reach.slope;
        double crude = reach_at(d.reach, order, box.high), near = size + spread;
        /* The lowest rate by the slope at the highest, which changes by no more than the lean. */
        double lowest = size_of(minus(value, times(height, slope)), column);
        double line = larger(size, lowest) + turn + height * lean;
        double least_bound = line < near ? line : near;
        least_bound = crude < least_bound ? crude : least_bound;
        if (!block->turns && !(least_bound <= cut_of(*known)))
            least_bound = smaller(least_bound, tangent_bound(&d, middle, box.high, value, slope,
                                                             width, height));
        if (!(size < INFINITY))
            return NAN;
        *known = larger(*known, size);
        bool is_last = left <= 0 || count + 2 > STACK || is_spent;
        if (least_bound <= cut_of(*known) || is_last) {
            bound = larger(bound, least_bound);
            continue;
        }
        bool is_climbing = height <= 0.0 || inner(value, slope, column)
                           >= size * lean + climb * spread + spread * lean;
        double place = step_within(&d, box.from, box.to);
        if (is_climbing && box.high < 1.0)
            continue;
        if (is_climbing && (place < 0.0 || hull <= cut_of(*known))) {
            double here = hull <= cut_of(*known) ? hull : hull_of(&d, box.from, box.to, known);
            if (here <= cut_of(*known) || width <= NARROW) {
                bound = larger(bound, here < least_bound ? here : least_bound);
                continue;
            }
        }
        if (is_climbing || turn >= height * (d.by_rate < lean ? d.by_rate : lean)) {
            double split = place > 0.0 ? place : middle;
            boxes[count++] = (box_t){box.from, split, box.low, box.high};
            boxes[count++] = (box_t){split, box.to, box.low, box.high};
        } else {
            double split = box.high - 0.5 * height;
            boxes[count++] = (box_t){box.from, box.to, box.low, split};
            boxes[count++] = (box_t){box.from, box.to, split, box.high};
        }
    }
    return bound;
}
