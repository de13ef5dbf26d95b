/* Certify setpoints, a block after the other. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "differences.h"
#include "quintic.h"
#include "trajectory.h"

/* Seconds before its end that a path counts as ended: its last record is at rest, to rounding. */
#define AT_REST 1e-9

index_t setpoints_of(const setpoints_t *from) { return from->before.n + from->count + from->held; }

void begin_block(const setpoints_t *from, block_t *block) {
    block->turns = from->turns, block->count = block->unknown = 0;
    block->first = from->first - from->before.n;
}

void begin_sight(sight_t *sight, index_t boxes) {
    memset(sight->known, 0, sizeof sight->known);
    sight->unproven = 0, sight->boxes = boxes;
}

/* Take the rates from a setpoint. */
static void hold_at(block_t *block, index_t i) {
    for (index_t row = RATES; row < TURN_ROWS; row++)
        block->rows[row][i] = 0.0;
}

/* Write turns of a trajectory at some times. */
static void sample_turns(const setpoints_t *from, row_t times, index_t begin, block_t *block) {
    double samples[TURN_ROWS * BLOCK], rate = from->step / from->period, square = rate * rate;
    matrix_t out = {samples, TURN_ROWS, times.n};
    sample_trajectory(times, from->breaks, from->pieces, INFINITY, out);
    for (index_t row = 0; row < TURN_ROWS; row++) {
        const double *restrict found = row_of(out, row);
        double *restrict to = block->rows[row] + begin;
        double factor = row < 4 ? 1.0 : row < 7 ? rate : square;
        for (index_t i = 0; i < times.n; i++)
            to[i] = factor * found[i];
    }
}

/* Write positions at some times. */
static void sample_moves(const setpoints_t *from, row_t times, index_t begin, block_t *block) {
    double rate = from->step / from->period;
    for (index_t i = 0; i < times.n; i++) {
        double place[3], speed[3];
        put_move(from->breaks, from->pieces, times.v[i], (move_t){place, speed, NULL});
        for (index_t axis = 0; axis < 3; axis++) {
            block->rows[axis][begin + i] = place[axis];
            block->rows[RATES + axis][begin + i] = rate * speed[axis];
        }
    }
}

/* Write records of a trajectory, the first of which is at a place in the block. */
static void sample_block(const setpoints_t *from, index_t first, index_t begin, index_t end,
                         block_t *block) {
    double times[BLOCK], start = from->breaks.v[0], stop = from->breaks.v[from->breaks.n - 1];
    index_t count = end - begin, last = from->first + from->count - 1;
    for (index_t i = 0; i < count; i++)
        times[i] = from->step * (double)least(first + i, last);
    if (from->turns) {
        for (index_t i = 0; i < count; i++)
            times[i] = smaller(times[i], stop);
        sample_turns(from, (row_t){times, count}, begin, block);
    } else
        sample_moves(from, (row_t){times, count}, begin, block);
    for (index_t i = 0; i < count && from->rests[0] && times[i] <= start; i++)
        hold_at(block, begin + i);
    for (index_t i = count - 1; i >= 0 && from->rests[1] && times[i] >= stop - AT_REST; i--)
        hold_at(block, begin + i);
}

/* Write a setpoint that is given as a row. */
static void take_row(const setpoints_t *from, const double *row, index_t i, block_t *block) {
    for (index_t k = 0; k < (from->turns ? TURN_ROWS : PLAIN_ROWS); k++)
        block->rows[from->turns || k < 3 ? k : RATES + k - 3][i] = row[k];
}

index_t fill_block(const setpoints_t *from, index_t place, block_t *block) {
    index_t kept = least(block->count, KEPT), gone = block->count - kept;
    for (index_t row = 0; row < TURN_ROWS && gone; row++)
        memmove(block->rows[row], block->rows[row] + gone, (size_t)kept * sizeof(double));
    block->first += gone;
    index_t end = least(setpoints_of(from), place + BLOCK - kept), at = kept;
    for (; place < end && place < from->before.n; place++, at++)
        take_row(from, row_of(from->before, place), at, block);
    index_t record = place - from->before.n, stop = at + end - place;
    if (from->rows.n)
        for (index_t i = at; i < stop; i++)
            take_row(from, row_of(from->rows, least(record + i - at, from->count - 1)), i, block);
    else if (stop > at)
        sample_block(from, from->first + record, at, stop, block);
    /* The setpoints after the last one hold it, so their rates are zero. */
    for (index_t i = most(at, at + from->count - record); i < stop; i++)
        hold_at(block, i);
    block->count = stop;
    block->unknown = stop;
    while (block->unknown > 0 && !isnan(block->rows[RATES][block->unknown - 1]))
        block->unknown--;
    return end;
}

/* Note how long the longest stop takes, on a straight path: a double integrator with bounded jerk,
 * from the speed and its rate of change to rest. */
static void take_stops(const block_t *block, index_t begin, const measure_t *how,
                       extremes_t *found) {
    const double (*rows)[BLOCK] = block->rows;
    const double *bends = row_of(how->limits, 1), *twists = row_of(how->limits, 2);
    lane_t times_of;
    INDEPENDENT
    for (index_t i = begin; i < block->count; i++) {
        vec_t omega = vec(rows[4][i], rows[5][i], rows[6][i]);
        double speed = norm(omega);
        vec_t way = times(speed > 0.0 ? 1.0 / speed : 0.0, omega);
        double push = dot(way, vec(rows[7][i], rows[8][i], rows[9][i]));
        double x = fabs(way.x), y = fabs(way.y), z = fabs(way.z);
        double pull = smaller(smaller(bends[0], bends[1] / x), smaller(bends[2] / y, bends[3] / z));
        double jerk = smaller(smaller(twists[0], twists[1] / x),
                              smaller(twists[2] / y, twists[3] / z));
        double peak = sqrt(jerk * speed + 0.5 * push * push);
        double brief = larger(push + 2.0 * peak, 0.0) / jerk;
        double held = speed + (push * push - 2.0 * pull * pull) / (2.0 * jerk);
        times_of[i] = peak <= pull ? brief : (push + 2.0 * pull) / jerk + held / pull;
    }
    for (index_t i = begin; i < block->count; i++)
        if (times_of[i] > found->stop_time && times_of[i] < INFINITY)
            found->stop_time = times_of[i];
}

/* Share of a limit from which on a difference is taken to be about the largest. */
#define HIGH 0.9

typedef struct {
    const setpoints_t *from;
    const measure_t *how;
    extremes_t *found;
    block_t block;
    sight_t sight;
} certifying_t;

/* Bounds of the differences in a block, and the place where the block begins. */
typedef struct { double bounds[12]; index_t place, past; } outline_t;

/* Return whether a difference is looked for and may be larger than the largest that is known. */
static bool is_open(const certifying_t *at, const outline_t *outline, int slot) {
    return is_wanted(at->how, slot)
        && !(outline->bounds[slot] <= cut_of(at->sight.known[slot / 4][slot % 4]));
}

/* Look at a block between its records, too. */
static void look_closely(certifying_t *at, const outline_t *outline) {
    take_phases(&at->block, true, &at->sight);
    note_differences(&at->block, outline->past, at->how, true, &at->sight, at->found);
    for (int slot = 0; slot < 12; slot++)
        if (is_open(at, outline, slot)) {
            prove(&at->block, outline->past, slot / 4 + 1, slot % 4, &at->sight, at->found);
        } else if (is_wanted(at->how, slot)) {
            note(outline->bounds[slot], at->found->squares + slot);
            for (index_t i = 0; i < BLOCK; i++)
                at->sight.proven[slot][i] = INFINITY;
        }
    brake(&at->block, &at->sight, at->from->period, at->how, at->found);
}

/* Write bounds of the differences in a block; return whether the block needs a check now. */
static bool put_outline(const certifying_t *at, outline_t *outline) {
    double unit = 1.0;
    bool is_high = at->block.unknown > 0;
    for (int slot = 0; slot < 12; slot++) {
        unit *= slot % 4 ? 1.0 : at->from->period;
        outline->bounds[slot] = 0.0;
        if (!is_wanted(at->how, slot))
            continue;
        double limit = row_of(at->how->limits, slot / 4)[slot % 4];
        outline->bounds[slot] = crude_bound(&at->sight, slot / 4 + 1, slot % 4);
        is_high |= at->sight.known[slot / 4][slot % 4] > HIGH * limit * unit
                && is_open(at, outline, slot);
    }
    return is_high || is_risky(outline->bounds, at->from->period, at->how, at->found->rate);
}

/* Bound all differences: where it might matter between the records, too.  A block that is far below
 * the limits is left until the largest differences on the records are known. */
static int prove_all(certifying_t *at) {
    const setpoints_t *from = at->from;
    index_t total = setpoints_of(from), count = 0, past = from->before.n > 0;
    outline_t *left = malloc((size_t)(total / (BLOCK - KEPT) + 2) * sizeof *left);
    if (left == NULL)
        return OUT_OF_MEMORY;
    for (index_t read = 0; read < total;) {
        index_t known = least(at->block.count, KEPT);
        outline_t outline = {.place = read, .past = past};
        read = fill_block(from, read, &at->block);
        take_records(&at->block, from->period, true, &at->sight);
        note_differences(&at->block, past, at->how, false, &at->sight, at->found);
        if (put_outline(at, &outline))
            look_closely(at, &outline);
        else
            left[count++] = outline;
        if (from->turns)
            take_stops(&at->block, known, at->how, at->found);
        past = 0;
    }
    for (index_t i = 0; i < count; i++) {
        bool is_needed = is_risky(left[i].bounds, from->period, at->how, at->found->rate);
        for (int slot = 0; slot < 12; slot++)
            is_needed |= is_open(at, &left[i], slot);
        for (int slot = 0; slot < 12 && !is_needed; slot++)
            note(left[i].bounds[slot], at->found->squares + slot);
        if (!is_needed)
            continue;
        begin_block(from, &at->block);
        at->block.first += most(left[i].place - KEPT, 0);
        fill_block(from, most(left[i].place - KEPT, 0), &at->block);
        take_records(&at->block, from->period, true, &at->sight);
        look_closely(at, &left[i]);
    }
    free(left);
    return 0;
}

int certify(const setpoints_t *from, const measure_t *how, extremes_t *found) {
    certifying_t *at = malloc(sizeof *at);
    *found = (extremes_t){.rate = how->law.fastest};
    if (at == NULL)
        return OUT_OF_MEMORY;
    index_t total = setpoints_of(from), past = from->before.n > 0;
    int failed = 0;
    at->from = from, at->how = how, at->found = found;
    begin_sight(&at->sight, BOXES_AT_LEAST + BOXES_A_RECORD * total);
    begin_block(from, &at->block);
    if (how->tolerance > 0.0)
        failed = prove_all(at);
    else
        for (index_t read = 0; read < total; past = 0) {
            read = fill_block(from, read, &at->block);
            take_records(&at->block, from->period, false, &at->sight);
            take_phases(&at->block, false, &at->sight);
            note_differences(&at->block, past, at->how, true, &at->sight, found);
        }
    found->unproven = (double)at->sight.unproven;
    free(at);
    return failed;
}
