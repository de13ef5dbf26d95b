/* Bounds of the backward differences of setpoints, a block of records at a time.
 *
 * A device knows setpoints, not derivatives.  It takes the rotation vector from one setpoint to the
 * next over a period for the velocity, the change of that for the acceleration and the change of
 * that for the jerk.  Setpoints lie on the records while a motion runs as planned, and anywhere
 * between them, a constant share of a period apart, after a pause, a stop or at another speed.
 * Where the records have their rates, what is bounded here holds for all of these: for every phase
 * of the setpoints against the records and for every rate of the path in [0, 1].
 */
#ifndef ORIENTD_DIFFERENCES_H
#define ORIENTD_DIFFERENCES_H

#include "between.h"
#include "certify.h"

/* Records in a block; each but the first begins with the last KEPT of the one before, so that every
 * difference has those before and after it in one block. */
enum { BLOCK = 256, KEPT = HISTORY + 2 };

/* The row of a block in which velocities begin. */
enum { RATES = 4 };

/* Phases at which a difference is taken, the record itself being the first: with the record after
 * it they are the nodes of a polynomial of the fourth degree. */
enum { PHASES = 4, PHASE_NODES = PHASES + 1 };

/* Square of the tangent of half an angle, below which the series of the next function is exact to
 * the last digit. */
#define SMALL (1.0 / 1024.0)

/* 2 atan(t) / t, of the square of t. */
INLINE double turn_factor(double square) {
    double rest = 1.0 / 5 - square * (1.0 / 7 - square * (1.0 / 9 - square / 11));
    return 2.0 * (1.0 - square * (1.0 / 3 - square * rest));
}

typedef double lane_t[BLOCK];
typedef struct { lane_t x, y, z; } lanes_t;

INLINE vec_t at(const lanes_t *lanes, index_t i) {
    return vec(lanes->x[i], lanes->y[i], lanes->z[i]);
}

INLINE void put(lanes_t *lanes, index_t i, vec_t v) {
    lanes->x[i] = v.x, lanes->y[i] = v.y, lanes->z[i] = v.z;
}

/* By how much a bound may be larger than the largest difference found, as a share of that and as
 * an angle, rad; the latter is of the size of rounding. */
#define SLACK 3e-4
#define ROUNDING 3e-14

/* Return what a bound need not be less than where the largest difference found is known. */
INLINE double cut_of(double known) { return known * (1.0 + SLACK) + ROUNDING; }

/* Phases of the nodes. */
INLINE double node_of(index_t n) {
    static const double nodes[PHASE_NODES] = {0.0, 0.1464466094067262, 0.5, 0.8535533905932737, 1.0};
    return nodes[n];
}

/* What the value at a node counts in the Bernstein coefficient of a polynomial of the fourth
 * degree. */
INLINE double bernstein(index_t coefficient, index_t node) {
    static const double weights[PHASE_NODES][PHASE_NODES] = {
        {1.0, 0.0, 0.0, 0.0, 0.0},
        {-1.75, 3.414213562373095, -1.0, 0.585786437626905, -0.25},
        {7.0 / 6, -8.0 / 3, 4.0, -8.0 / 3, 7.0 / 6},
        {-0.25, 0.585786437626905, -1.0, 3.414213562373095, -1.75},
        {0.0, 0.0, 0.0, 0.0, 1.0},
    };
    return weights[coefficient][node];
}

/* The size of a vector, or of one of its components. */
INLINE double size_of(vec_t v, int column) {
    return column == 0 ? norm(v) : fabs(column == 1 ? v.x : column == 2 ? v.y : v.z);
}

/* Setpoints of a channel, of which the first ones may have no rates, being not numbers.  The first is
 * that of a record.  Velocities begin in row RATES, so that three values leave a row out. */
typedef struct {
    bool turns;
    double rows[TURN_ROWS][BLOCK];
    index_t count, unknown, first;
} block_t;

/* Properties of the path between each record and the next.  The unit of time is a period.
 *
 * first, second, third, step, place: the law.
 * leave, arrive: angular velocity at both ends, rad.
 * begin, end, before, behind: angular acceleration at both ends and before and behind its step.
 * jerk, spin: the jerk at the beginning, and by how much it turns until the end.
 * jump: step of the acceleration at the record behind, but for loose, by which it may be larger.
 * jumped: the size of all of that.
 * speed, bend, twist: bounds of velocity, acceleration and jerk but for that of a step.
 * turning: the velocity again if it is that of a turn, else 0: what does not commute grows with it.
 * spread: largest difference between the real jerk and this one.
 * steps: the size of the step.
 * coupling: bounds of F, N and N' of segments.c between the record, the next and the one after that.
 * slope: of the derivative of F by the rate.
 * rest: error of the first differences over that time against a polynomial of the fourth degree. */
typedef struct {
    lanes_t first, second, third, step;
    lane_t place;
    lanes_t leave, arrive, begin, end, before, behind, jerk, spin, jump;
    lane_t speed, bend, twist, turning, spread, steps, loose, jumped;
    lane_t coupling[3], slope, rest;
} segments_t;

/* Differences at the records and at the phases behind them, and bounds for all phases.
 *
 * q: setpoints at the phases: orientations, or three values.
 * rates: their differences, of three orders.
 * hulls: Bernstein coefficients of the first ones.
 * known: the largest that was found of each, which is a lower bound.
 * proven: by slot of extremes_t, bounds of the differences behind each record for all phases and
 *     rates; infinite until one is needed.
 * counts, windows: how many differences of an order there are on the records, and behind them.
 * first: from which record on there are the latter.
 * unproven: periods in which the path turns too far for a proof, and bounds that were not tight when
 *     no boxes were left; differences there are looked at at the phases only.
 * boxes: of phases and rates that may still be looked at, so that every call ends soon. */
typedef struct {
    lane_t q[PHASES][4];
    lanes_t rates[PHASES][3];
    lanes_t hulls[PHASE_NODES];
    double known[3][4];
    lane_t proven[12];
    segments_t segments;
    index_t counts[3], windows[3], first, unproven, boxes;
} sight_t;

/* Note a size of which the square is kept; one that is not a number is, and stays, the largest. */
INLINE void note(double size, double *square) {
    if (!(size * size <= *square) && *square < INFINITY)
        *square = size * size;
}

/* Begin with nothing found, and so many boxes that may be looked at. */
void begin_sight(sight_t *sight, index_t boxes);

/* Begin a block with no setpoints; the first to come is at a place among those there are. */
void begin_block(const setpoints_t *from, block_t *block);

/* Return how many setpoints there are. */
index_t setpoints_of(const setpoints_t *from);

/* Move the last setpoints of a block to its beginning, and fill it up with those from a place on.
 * Return the place of the first that is not in it. */
index_t fill_block(const setpoints_t *from, index_t place, block_t *block);

/* Take the differences of the records of a block, and what is known of the path between them.
 *
 * period: from one setpoint to the next, s.
 * is_proof: whether bounds are wanted. */
void take_records(const block_t *block, double period, bool is_proof, sight_t *sight);

/* Take the differences at the phases between them, too. */
void take_phases(const block_t *block, bool is_proof, sight_t *sight);

/* Note the largest differences that were taken.
 *
 * past: how many accelerations, and twice as many velocities, are not to count as largest.
 * with_phases: whether those between the records count.
 * sight: begun before the first block. */
void note_differences(const block_t *block, index_t past, const measure_t *how, bool with_phases,
                      sight_t *sight, extremes_t *found);

/* Return what no difference of a kind exceeds, at any phase and rate; infinite without a proof. */
double crude_bound(const sight_t *sight, index_t order, int column);

/* Note bounds of the differences of a kind, close where they are near the largest that was found. */
void prove(const block_t *block, index_t past, index_t order, int column, sight_t *sight,
           extremes_t *found);

/* Return whether a difference is looked for, by its slot in extremes_t. */
INLINE bool is_wanted(const measure_t *how, int slot) {
    return slot / 4 < how->limits.n && slot % 4 >= how->first && slot % 4 < how->end;
}

/* Return a bound of a difference behind a record at the rate 1, whatever the phase. */
double hull_behind(const sight_t *sight, index_t i, index_t order, int column);

/* Return whether a difference behind a record grows with the rate, whatever the phase. */
bool grows(const sight_t *sight, index_t i, index_t order, int column);

/* brake.c */

/* Return whether differences up to some bounds might not let a path be slowed down at a rate. */
bool is_risky(const double bounds[12], double period, const measure_t *how, double rate);

/* Lower the brake rate to the least that is safe in a block at any phase. */
void brake(const block_t *block, const sight_t *sight, double period, const measure_t *how,
           extremes_t *found);

/* segments.c */

/* The law between a record and the next. */
INLINE law_t law_of(const segments_t *segments, index_t k) {
    return (law_t){at(&segments->first, k), at(&segments->second, k), at(&segments->third, k),
                   at(&segments->step, k), segments->place[k]};
}

/* Write the laws between the records of a block, and the velocities there.
 *
 * turns: rotation vectors from each record to the next. */
void put_laws(const block_t *block, double period, const lanes_t *turns, segments_t *segments);

/* Write what else there is to know of some laws.
 *
 * is_turn: whether they are of a turn; otherwise all of them commute. */
void put_segments(index_t count, bool is_turn, const lanes_t *turns, segments_t *segments);

/* Return the step of the acceleration at the record behind, or of a component of it. */
INLINE double jump_of(const segments_t *segments, index_t k, int column) {
    return column == 0 ? segments->jumped[k]
                       : size_of(at(&segments->jump, k), column) + segments->loose[k];
}

/* What bounds differences of an order that begin behind a record, whatever the phase and the rate.
 *
 * most: of velocity, acceleration or jerk, of the norm or a component.
 * steps: in the acceleration.
 * impulse: what they can add to a third difference.  A step counts with the weight that a quadratic
 *     B-spline has there: at most 0.75, and at records, a period apart, at most 1 for all of them.
 * off, slope: what does not commute, and its derivative by the rate. */
typedef struct { double most, steps, impulse, off, slope; } reach_t;

/* Return the step of the acceleration between a record and the next, or of a component of it. */
INLINE double step_of(const segments_t *segments, index_t k, int column) {
    double step = segments->steps[k];
    return column == 0 ? step : size_of(at(&segments->step, k), column)
                              + 0.6 * segments->turning[k] * step;
}

/* Return the largest size of a component of the jerk between a record and the next. */
INLINE double peak_of_jerk(const segments_t *segments, index_t k, int column) {
    vec_t jerk = at(&segments->jerk, k), last = plus(jerk, at(&segments->spin, k));
    return larger(size_of(jerk, column), size_of(last, column)) + segments->spread[k];
}

/* Return the largest velocity, acceleration or jerk between a record and the next. */
INLINE double peak_of(const segments_t *segments, index_t k, index_t order, int column) {
    if (column == 0)
        return order == 1 ? segments->speed[k] : order == 2 ? segments->bend[k] : segments->twist[k];
    if (order == 1)
        return larger(size_of(at(&segments->leave, k), column),
                       size_of(at(&segments->arrive, k), column))
             + 0.125 * peak_of_jerk(segments, k, column) + 0.25 * step_of(segments, k, column);
    if (order == 2)
        return larger(larger(size_of(at(&segments->begin, k), column),
                               size_of(at(&segments->end, k), column)),
                       larger(size_of(at(&segments->before, k), column),
                               size_of(at(&segments->behind, k), column)))
             + 0.6 * segments->turning[k] * segments->bend[k];
    return peak_of_jerk(segments, k, column);
}

INLINE reach_t reach_of(const segments_t *segments, index_t i, index_t order, int column) {
    double first = step_of(segments, i, column), slope = 0.0, bend = 0.0, jumps = 0.0, jump = 0.0;
    reach_t reach = {peak_of(segments, i, order, column), first, 0.75 * first, 0.0, 0.0};
    for (index_t k = i; k < i + order; k++) {
        reach.most = larger(reach.most, peak_of(segments, k + 1, order, column));
        double at_record = jump_of(segments, k, column), step = step_of(segments, k + 1, column);
        reach.steps += at_record + step, reach.impulse += 0.75 * step;
        jumps += at_record, jump = larger(jump, at_record);
        reach.off = larger(reach.off, segments->coupling[order - 1][k]);
        slope = larger(slope, segments->slope[k]);
        bend = larger(bend, segments->coupling[order == 2 ? 1 : 2][k]);
    }
    reach.impulse += smaller(0.75 * jumps, jump);
    reach.slope = order == 1 ? slope : order == 2 ? 2.0 * slope + bend : 4.0 * slope + 2.0 * bend;
    return reach;
}

/* Return what bounds a difference at a rate and below it. */
INLINE double reach_at(reach_t reach, index_t order, double rate) {
    double most = reach.most * rate;
    if (order == 1)
        return most + reach.off;
    return (order == 2 ? most * rate : most * rate * rate + rate * rate * reach.impulse)
         + reach.off;
}

/* Return a rate up to which no difference is larger than a known one. */
INLINE double lowest_rate(reach_t reach, index_t order, double known) {
    double all = reach.most + (order == 3 ? reach.impulse : 0.0);
    double rate = (known - reach.off) / (all > 0.0 ? all : 1.0);
    rate = rate > 0.0 ? rate < 1.0 ? rate : 1.0 : 0.0;
    return order == 1 ? rate : sqrt(rate);
}

/* enclosure.c */

#define NOT_TIGHT -1.0

/* Boxes that a call may look at. */
enum { BOXES_AT_LEAST = 100000, BOXES_A_RECORD = 8 };

/* Return a bound of a difference for every rate in [0, 1] and every phase behind a record.
 *
 * i: the record.
 * order: of the difference, 1 to 3.
 * column: 0 for the norm, 1 to 3 for a component.
 * hull: a bound for the rate 1.
 * known: the largest difference found, which is updated.
 * boxes: how many may be looked at, which is updated.
 *
 * Return the bound, or NOT_TIGHT if there were too few boxes. */
double enclose(const block_t *block, const segments_t *segments, index_t i, index_t order,
               int column, double hull, double *known, index_t *boxes);

#endif
