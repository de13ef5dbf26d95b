/* Backward differences of a block of records and of the path between them, and the largest. */
#include <math.h>
#include <string.h>

#include "differences.h"

/* Angle within a period up to which the bounds are proven, rad. */
#define LARGEST_TURN 0.5

/* How far (u - f)^2 / 2 behind any f in [0, 1] is off the polynomial through its nodes, at most. */
#define BENT 0.0042

/* From a largest square to the same on the records alone. */
enum { ON_RECORDS = 12 };

/* Write the rotation vectors between setpoints, and return how many are too large for that. */
static index_t turn_near(double (*restrict q)[BLOCK], index_t count, lanes_t *restrict omega) {
    index_t large = 0;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        double a = q[0][i], b = q[1][i], c = q[2][i], d = q[3][i];
        double e = q[0][i + 1], f = q[1][i + 1], g = q[2][i + 1], h = q[3][i + 1];
        double w = a * e + b * f + c * g + d * h;
        double x = a * f - b * e - c * h + d * g;
        double y = a * g + b * h - c * e - d * f;
        double z = a * h - b * g + c * f - d * e;
        double square = (x * x + y * y + z * z) / (w * w);
        large += !(square < SMALL);
        double factor = turn_factor(square) / w;
        omega->x[i] = factor * x, omega->y[i] = factor * y, omega->z[i] = factor * z;
    }
    return large;
}

/* Write the rotation vectors that the series is not good for. */
static void turn_far(double (*q)[BLOCK], index_t count, lanes_t *omega) {
    for (index_t i = 0; i < count; i++) {
        quat_t here = quat(q[0][i], q[1][i], q[2][i], q[3][i]);
        quat_t there = quat(q[0][i + 1], q[1][i + 1], q[2][i + 1], q[3][i + 1]);
        quat_t turn = multiplied(conjugated(here), there);
        if (turn.w < 0.0)
            turn = opposite(turn);
        if (turn.x * turn.x + turn.y * turn.y + turn.z * turn.z >= SMALL * (turn.w * turn.w))
            put(omega, i, times(2.0, logarithm(turn)));
    }
}

/* Write the steps between setpoints that are not turns. */
static void step(double (*restrict values)[BLOCK], index_t count, lanes_t *restrict rates) {
    double *lanes[3] = {rates->x, rates->y, rates->z};
    for (int k = 0; k < 3; k++)
        for (index_t i = 0; i < count; i++)
            lanes[k][i] = values[k][i + 1] - values[k][i];
}

/* Write the differences of setpoints, of all orders. */
static void differ(double (*q)[BLOCK], bool is_turn, index_t setpoints, lanes_t *rates) {
    if (!is_turn)
        step(q, setpoints - 1, rates);
    else if (turn_near(q, setpoints - 1, rates))
        turn_far(q, setpoints - 1, rates);
    for (index_t order = 1; order < 3; order++) {
        const lanes_t *lower = rates + order - 1;
        lanes_t *higher = rates + order;
        INDEPENDENT
        for (index_t i = 0; i < setpoints - 1 - order; i++)
            put(higher, i, minus(at(lower, i + 1), at(lower, i)));
    }
}

/* Write the setpoints at a phase that are not turns. */
static void draw_values(const block_t *block, const segments_t *segments, double u,
                        double (*restrict values)[BLOCK]) {
    const double (*rows)[BLOCK] = block->rows;
    INDEPENDENT
    for (index_t i = 0; i < block->count - 1; i++) {
        vec_t way = law_value(law_of(segments, i), u);
        values[0][i] = rows[0][i] + way.x;
        values[1][i] = rows[1][i] + way.y;
        values[2][i] = rows[2][i] + way.z;
    }
}

/* Write the turns at a phase. */
static void draw_turns(const block_t *block, const segments_t *segments, double u,
                       double (*restrict q)[BLOCK]) {
    const double (*rows)[BLOCK] = block->rows;
    INDEPENDENT
    for (index_t i = 0; i < block->count - 1; i++) {
        law_t law = law_of(segments, i);
        double c, s;
        quat_t here = quat(rows[0][i], rows[1][i], rows[2][i], rows[3][i]);
        here = turned_by(here, law_value(law, u), &c, &s);
        q[0][i] = here.w, q[1][i] = here.x, q[2][i] = here.y, q[3][i] = here.z;
    }
}

/* Write the Bernstein coefficients of the first differences over a period. */
static void put_hulls(sight_t *sight, index_t windows) {
    for (index_t k = 0; k < PHASE_NODES; k++) {
        lanes_t *restrict to = sight->hulls + k;
        INDEPENDENT
        for (index_t i = 0; i < windows; i++) {
            vec_t sum = times(bernstein(k, PHASES), at(&sight->rates[0][0], i + 1));
            for (index_t n = 0; n < PHASES; n++)
                sum = plus(sum, times(bernstein(k, n), at(&sight->rates[n][0], i)));
            put(to, i, sum);
        }
    }
}

/* A Bernstein coefficient of a difference of an order. */
INLINE vec_t coefficient(const sight_t *sight, index_t k, index_t i, index_t order) {
    const lanes_t *hull = sight->hulls + k;
    vec_t here = at(hull, i);
    if (order == 1)
        return here;
    vec_t next = at(hull, i + 1);
    return order == 2 ? minus(next, here)
                      : plus(minus(at(hull, i + 2), times(2.0, next)), here);
}

/* Return whether a vector and all within a distance are within 30 degrees of a direction, or on
 * the same side. */
INLINE bool is_along(vec_t v, double distance, vec_t way, int column) {
    double size = size_of(v, column), length = size_of(way, column);
    double along = column == 0 ? dot(v, way) : column == 1 ? v.x * way.x
                 : column == 2 ? v.y * way.y : v.z * way.z;
    double share = column == 0 ? 0.8660254037844387 : 0.0;
    return along - distance * length >= share * (size + distance) * length;
}

/* Return whether a difference grows with the rate, whatever the phase: what it is an average of
 * lies within a cone, and what does not commute, and jumps that do not, cannot take it out of
 * that. */
INLINE bool is_growing(const segments_t *segments, index_t i, index_t order, int column,
                       reach_t reach) {
    double slightest = INFINITY, jumps = 0.0;
    vec_t way = order == 1 ? at(&segments->arrive, i)
              : order == 2 ? at(&segments->begin, i + 1)
                           : plus(at(&segments->jerk, i + 1), at(&segments->jerk, i + 2));
    bool is_one = true;
    for (index_t k = i; k <= i + order; k++) {
        double loose = segments->turning[k] * segments->bend[k], distance;
        vec_t first, last;
        if (order == 1) {
            first = at(&segments->leave, k), last = at(&segments->arrive, k);
            distance = 0.125 * peak_of_jerk(segments, k, column)
                     + 0.25 * step_of(segments, k, column);
        } else if (order == 2) {
            first = at(&segments->begin, k), last = at(&segments->end, k);
            distance = 0.6 * loose;
            is_one &= is_along(at(&segments->before, k), distance, way, column)
                    & is_along(at(&segments->behind, k), distance, way, column);
        } else {
            first = at(&segments->jerk, k), last = plus(first, at(&segments->spin, k));
            distance = segments->spread[k];
            double step = step_of(segments, k, column);
            double slack = 0.6 * segments->turning[k] * segments->steps[k];
            jumps += is_along(at(&segments->step, k), slack, way, column) ? 0.0 : step;
            jumps += k < i + order ? jump_of(segments, k, column) : 0.0;
        }
        is_one &= is_along(first, distance, way, column) & is_along(last, distance, way, column);
        double size = size_of(first, column), other = size_of(last, column);
        size = (size < other ? size : other) - distance;
        if (order == 2) {
            double before = size_of(at(&segments->before, k), column) - distance;
            double behind = size_of(at(&segments->behind, k), column) - distance;
            size = before < size ? before : size, size = behind < size ? behind : size;
        }
        slightest = size < slightest ? size : slightest;
    }
    double least_sum = 0.866 * slightest;
    double off = (reach.off + 0.75 * jumps) / least_sum;
    double lean = (reach.slope + 3.0 * jumps) / ((double)order * least_sum);
    return is_one & (least_sum > 0.0) & (off + lean + off * lean <= 0.5);
}

/* Return a bound of a difference at the rate 1, or a given one if that is less. */
INLINE double hull_at(const sight_t *sight, index_t i, index_t order, int column, double crude) {
    const segments_t *segments = &sight->segments;
    const double weights[4] = {1.0, (double)order, order == 3 ? 3.0 : 1.0, 1.0};
    double hull = 0.0, rest = 0.0, bent = 0.0;
    for (index_t k = 0; k < PHASE_NODES; k++)
        hull = larger(hull, size_of(coefficient(sight, k, i, order), column));
    for (index_t k = 0; k < order; k++)
        rest = larger(rest, segments->rest[i + k]);
    for (index_t k = 0; k <= order; k++)
        bent += weights[k] * segments->steps[i + k];
    hull += (order == 1 ? 1.0 : order == 2 ? 2.0 : 4.0) * rest + BENT * bent;
    return hull < crude ? hull : crude;
}

double hull_behind(const sight_t *sight, index_t i, index_t order, int column) {
    return hull_at(sight, i, order, column, INFINITY);
}

bool grows(const sight_t *sight, index_t i, index_t order, int column) {
    const segments_t *segments = &sight->segments;
    return is_growing(segments, i, order, column, reach_of(segments, i, order, column));
}

/* Write bounds of differences over a period behind each record: while the path runs as planned, and
 * at every rate.
 *
 * known: a difference that is as large as the largest that is looked for. */
INLINE void put_bounds(const sight_t *sight, index_t begin, index_t order, int column,
                       double known, double *restrict hulls, double *restrict bounds) {
    const segments_t *segments = &sight->segments;
    INDEPENDENT
    for (index_t i = begin; i < sight->windows[order - 1]; i++) {
        reach_t reach = reach_of(segments, i, order, column);
        double crude = reach_at(reach, order, 1.0), hull = hull_at(sight, i, order, column, crude);
        double found = 0.0, turning = 0.0;
        for (index_t p = 0; p < PHASES; p++)
            found = larger(found, size_of(at(&sight->rates[p][order - 1], i), column));
        for (index_t k = 0; k <= order; k++)
            turning = larger(turning, segments->turning[i + k]);
        /* From the rate on at which the averages allow more than is known already. */
        double low = lowest_rate(reach, order, known);
        double fall = order == 1 ? reach.most : (double)order * (reach.most + reach.steps);
        double near = larger(known, hull + (1.0 - low) * (fall + reach.slope));
        crude = near < crude ? near : crude;
        hulls[i] = hull;
        bounds[i] = turning <= LARGEST_TURN ? crude : found;
    }
}

/* The same for any order and column, each with a loop of its own. */
static void put_bounds_of(const sight_t *sight, index_t begin, index_t order, int column,
                          double known, double *restrict hulls, double *restrict bounds) {
    switch (4 * order + column) {
    case 4: put_bounds(sight, begin, 1, 0, known, hulls, bounds); break;
    case 8: put_bounds(sight, begin, 2, 0, known, hulls, bounds); break;
    case 12: put_bounds(sight, begin, 3, 0, known, hulls, bounds); break;
    default: put_bounds(sight, begin, order, column, known, hulls, bounds);
    }
}

/* Return whether some vectors are larger than a size, or not numbers, but for rounding. */
INLINE bool is_any_above(const lanes_t *vectors, index_t begin, index_t end, int column, double size) {
    double square = size * size * (1.0 - 1e-15);
    index_t above = 0;
    INDEPENDENT
    for (index_t i = begin; i < end; i++) {
        vec_t v = at(vectors, i);
        double one = column == 0 ? dot(v, v) : column == 1 ? v.x * v.x
                   : column == 2 ? v.y * v.y : v.z * v.z;
        above += !(one <= square);
    }
    return above > 0;
}

/* The same for any column, each with a loop of its own. */
static bool are_above(const lanes_t *vectors, index_t begin, index_t end, int column, double size) {
    switch (column) {
    case 0: return is_any_above(vectors, begin, end, 0, size);
    case 1: return is_any_above(vectors, begin, end, 1, size);
    case 2: return is_any_above(vectors, begin, end, 2, size);
    default: return is_any_above(vectors, begin, end, 3, size);
    }
}

/* Note the differences of a kind on the records, and at the phases behind them. */
static void note_found(sight_t *sight, index_t first, index_t order, int column, index_t shift,
                       index_t phases, extremes_t *found) {
    index_t slot = 4 * (order - 1) + column;
    double *known = &sight->known[order - 1][column];
    double *on_records = found->squares + ON_RECORDS + slot;
    const lanes_t *rates = &sight->rates[0][order - 1];
    if (are_above(rates, first, sight->counts[order - 1], column, sqrt(*on_records)))
        for (index_t i = first; i < sight->counts[order - 1]; i++)
            note(size_of(at(rates, i), column), on_records);
    for (index_t phase = 0; phase < phases; phase++) {
        index_t end = phase ? sight->windows[order - 1] : sight->counts[order - 1];
        index_t begin = phase ? most(first, sight->first) : first;
        rates = &sight->rates[phase][order - 1];
        if (!are_above(rates, begin, end, column, *known))
            continue;
        for (index_t i = begin; i < end; i++) {
            double size = size_of(at(rates, i), column);
            if (!(size <= *known) && *known < INFINITY)
                *known = size, found->places[slot] = (double)(shift + i + order);
        }
    }
}

INLINE double crude_bound_of(const sight_t *sight, index_t order, int column) {
    const segments_t *segments = &sight->segments;
    double largest = 0.0;
    lane_t bounds;
    INDEPENDENT
    for (index_t i = sight->first; i < sight->windows[order - 1]; i++) {
        double turning = 0.0, bound = reach_at(reach_of(segments, i, order, column), order, 1.0);
        for (index_t k = 0; k <= order; k++)
            turning = larger(turning, segments->turning[i + k]);
        bounds[i] = turning <= LARGEST_TURN ? bound : INFINITY;
    }
    for (index_t i = sight->first; i < sight->windows[order - 1]; i++)
        if (!(bounds[i] <= largest) && largest == largest)
            largest = bounds[i];
    return largest;
}

double crude_bound(const sight_t *sight, index_t order, int column) {
    switch (4 * order + column) {
    case 4: return crude_bound_of(sight, 1, 0);
    case 8: return crude_bound_of(sight, 2, 0);
    case 12: return crude_bound_of(sight, 3, 0);
    default: return crude_bound_of(sight, order, column);
    }
}

void prove(const block_t *block, index_t past, index_t order, int column, sight_t *sight,
           extremes_t *found) {
    lane_t hulls;
    double *known = &sight->known[order - 1][column];
    index_t slot = 4 * (order - 1) + column, first = (3 - order) * past;
    double *bounds = sight->proven[slot];
    put_bounds_of(sight, sight->first, order, column, *known, hulls, bounds);
    for (index_t i = most(first, sight->first); i < sight->windows[order - 1]; i++) {
        double bound = bounds[i];
        if (!(bound <= cut_of(*known)) && grows(sight, i, order, column))
            bound = hulls[i];
        if (!(bound <= cut_of(*known))) {
            double before = *known;
            bound = enclose(block, &sight->segments, i, order, column, hulls[i], known,
                            &sight->boxes);
            sight->unproven += bound == NOT_TIGHT;
            bound = bound == NOT_TIGHT ? *known : bound;
            bounds[i] = bound;
            if (*known > before)
                found->places[slot] = (double)(block->first + i + order);
        }
        note(bound, found->squares + slot);
    }
    note(*known, found->squares + slot);
}

void take_records(const block_t *block, double period, bool is_proof, sight_t *sight) {
    for (index_t order = 1; order <= 3; order++) {
        sight->counts[order - 1] = most(block->count - order, 0);
        sight->windows[order - 1] = block->unknown < block->count
                                  ? most(block->count - 1 - order, 0) : 0;
    }
    sight->first = least(block->unknown, sight->windows[0]);
    if (block->count < 2)
        return;
    memcpy(sight->q[0], block->rows, sizeof sight->q[0]);
    differ(sight->q[0], block->turns, block->count, sight->rates[0]);
    if (sight->windows[0])
        put_laws(block, period, &sight->rates[0][0], &sight->segments);
    if (sight->windows[0] && is_proof)
        put_segments(block->count - 1, block->turns, &sight->rates[0][0], &sight->segments);
}

void take_phases(const block_t *block, bool is_proof, sight_t *sight) {
    if (!sight->windows[0])
        return;
    for (index_t p = 1; p < PHASES; p++) {
        (block->turns ? draw_turns : draw_values)(block, &sight->segments, node_of(p), sight->q[p]);
        differ(sight->q[p], block->turns, block->count - 1, sight->rates[p]);
    }
    if (!is_proof)
        return;
    put_hulls(sight, sight->windows[0]);
    for (index_t k = sight->first; k < block->count - 1; k++)
        sight->unproven += !(sight->segments.turning[k] <= LARGEST_TURN);
}

void note_differences(const block_t *block, index_t past, const measure_t *how, bool with_phases,
                      sight_t *sight, extremes_t *found) {
    for (int slot = 0; slot < 12; slot++) {
        index_t order = slot / 4 + 1;
        int column = slot % 4;
        if (!is_wanted(how, slot))
            continue;
        index_t phases = with_phases && sight->windows[order - 1] > 0 ? PHASES : 1;
        note_found(sight, (3 - order) * past, order, column, block->first, phases, found);
        note(sight->known[order - 1][column], found->squares + slot);
    }
}
