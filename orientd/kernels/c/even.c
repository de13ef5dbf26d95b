/* A look at a motion at its own pace: where its limits matter, and how long it should be. */
#include "even.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "differences.h"
#include "moves.h"
#include "trajectory.h"

enum {
    FEWEST_PIECES = 64,     /* that a trajectory of fewer is cut into */
    LOOKS = 5,              /* in a piece */
    SHORT = 4 * 8192,       /* records that are looked at as a whole where the shape may change */
    GAP = 256,              /* records that cost less than another beginning */
    MARGIN = 4,             /* records on either side of a spot */
    END_KNOTS = 10,         /* to which the ends of a path reach, whatever the duration */
    MOST_RECORDS = 20000000, /* to look at in all */
    MOST_ATTEMPTS = 60,
    MOST_PREDICTIONS = 8,   /* attempts that trust the prediction; then bisection */
};

static const double SHARES[LOOKS] = {1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6}; /* of a piece */
#define HOT 0.97            /* of the largest factor, where a spot begins */
#define PRECISION 1e-3      /* of the shortest duration */
#define FAR 4.0             /* times the guess, beyond which nothing is looked at */
#define LARGEST_FACTOR 1e4  /* that a prediction is made from */

/* Instants, and by which factor the motion should take longer for each. */
typedef struct { double *instants, *factors; index_t n; double largest; } survey_t;

typedef struct {
    double samples[10 * BLOCK];
    block_t block;
    sight_t sight;
    index_t left;  /* records that may still be looked at */
} scratch_t;

/* Return a rate as a share of its limits, of the norm or of a component. */
INLINE double share(double x, double y, double z, const double *limits) {
    double most = fmax(fabs(y) / limits[2], fabs(z) / limits[3]);
    return fmax(sqrt(x * x + y * y + z * z) / limits[0], fmax(fabs(x) / limits[1], most));
}

/* Write instants on either side of every break and between them, and return how many. */
static index_t place_looks(const even_t *asked, double *instants) {
    const double *knots = asked->knots.v, *moves = asked->move_breaks.v;
    index_t known = asked->knots.n, moving = asked->move_breaks.n, i = 0, j = 0, k = 0, count = 0;
    double duration = knots[known - 1], before = -1.0;
    index_t pieces = known + moving <= FEWEST_PIECES ? FEWEST_PIECES : -1;
    while (i < known || j < moving || k <= pieces) {
        double own = i < known ? knots[i] : INFINITY, move = j < moving ? moves[j] : INFINITY;
        double even = k <= pieces ? duration * (double)k / (double)pieces : INFINITY;
        double here = fmin(own, fmin(move, even));
        /* Skip breaks that are NaN. */
        i += i < known && !(own > here), j += j < moving && !(move > here);
        k += k <= pieces && !(even > here);
        if (!(here >= 0.0 && here <= duration))
            continue;
        if (here > before && before >= 0.0)
            for (int look = 0; look < LOOKS; look++)
                instants[count++] = before + (here - before) * SHARES[look];
        before = here;
    }
    return count;
}

/* Write the factor of every instant at the duration that the trajectory has. */
static void weigh_looks(const even_t *asked, double slower, survey_t *survey, scratch_t *scratch) {
    double w[3], a[3], v[3], last[3] = {0.0}, pushed[3] = {0.0}, before = 0.0;
    double rate = 1.0 / slower;
    survey->largest = 0.0;
    for (index_t first = 0; first < survey->n; first += BLOCK) {
        index_t size = least(BLOCK, survey->n - first);
        matrix_t samples = {scratch->samples, 10, size};
        sample_trajectory((row_t){survey->instants + first, size}, asked->breaks, asked->pieces,
                          INFINITY, samples);
        for (index_t i = 0; i < size; i++) {
            double t = survey->instants[first + i];
            /* A shorter interval counts as one period, as for a step of the acceleration. */
            double elapsed = fmax(slower * (t - before), asked->period);
            bool is_first = first + i == 0;
            for (int k = 0; k < 3; k++) {
                w[k] = rate * row_of(samples, 4 + k)[i];
                a[k] = rate * rate * row_of(samples, 7 + k)[i];
            }
            double factor = share(w[0], w[1], w[2], row_of(asked->limits, 0));
            factor = fmax(factor, sqrt(share(a[0], a[1], a[2], row_of(asked->limits, 1))));
            if (!is_first) {
                double twist = share(a[0] - last[0], a[1] - last[1], a[2] - last[2],
                                     row_of(asked->limits, 2)) / elapsed;
                factor = fmax(factor, asked->step > 0.0 ? sqrt(asked->step * twist) : cbrt(twist));
            }
            if (asked->moves.n) {
                double speed = 0.0, push = 0.0;
                put_move(asked->move_breaks, asked->moves, t, (move_t){NULL, v, NULL});
                for (int k = 0; k < 3; k++) {
                    double change = rate * v[k] - pushed[k];
                    speed += rate * rate * v[k] * v[k];
                    push += is_first ? 0.0 : change * change;
                    pushed[k] = rate * v[k];
                }
                factor = fmax(factor, sqrt(speed) / asked->move_limits.v[0]);
                factor = fmax(factor, sqrt(sqrt(push) / elapsed / asked->move_limits.v[1]));
            }
            memcpy(last, a, sizeof last);
            before = t;
            survey->factors[first + i] = factor;
            survey->largest = fmax(survey->largest, factor);
        }
    }
}

/* The largest differences found, and how many records may still be looked at. */
typedef struct { extremes_t of; index_t left; } largest_t;

/* Take in the records from first to last of a motion with the given number of cycles. */
static void see_records(const even_t *asked, index_t first, index_t last, index_t final,
                        bool with_axes, largest_t *found, scratch_t *scratch) {
    double still[3] = {0.0}, state[HISTORY * STATE_ROWS];
    double duration = asked->knots.v[asked->knots.n - 1];
    setpoints_t from = {
        .breaks = asked->breaks, .pieces = asked->pieces, .move_breaks = asked->move_breaks,
        .moves = asked->moves, .place = {still, 3}, .first = first, .count = last - first + 1,
        .held = last == final && asked->is_held[1] ? HISTORY : 0,
        .period = asked->period, .step = duration / (double)final,
        .rests = {asked->is_held[0], asked->is_held[1]},
    };
    block_t *block = &scratch->block;
    begin_sight(&scratch->sight, 0);
    begin_block(&from, block);
    if (first == 0 && asked->is_held[0]) {
        fill_block(&from, 0, block);
        for (index_t i = 0; i < HISTORY * STATE_ROWS; i++)
            state[i] = block->rows[i % STATE_ROWS][0];
        from.before = (matrix_t){state, HISTORY, STATE_ROWS};
        begin_block(&from, block);
    }
    index_t total = setpoints_of(&from);
    found->left -= total;
    for (index_t read = 0; read < total && found->left >= 0;) {
        read = fill_block(&from, read, block);
        take_records(block, asked->period, false, &scratch->sight);
        take_phases(block, false, &scratch->sight);
        note_differences(block, 0, with_axes, true, &scratch->sight, &found->of);
        if (asked->moves.n)
            take_moves(block, asked->period, 0, &found->of);
    }
}

/* Return by which factor the motion that was looked at should take longer. */
static double excess_of(const even_t *asked, const largest_t *found) {
    double shares[6] = {0.0}, unit = 1.0, period = asked->period;
    for (index_t order = 0; order < 3; order++) {
        unit *= period;
        for (index_t row = order; row < 6; row += 3)
            for (index_t c = 0; c < 4; c++)
                shares[row] = fmax(shares[row], sqrt(found->of.squares[4 * row + c]) / unit
                                                / row_of(asked->limits, order)[c]);
    }
    double turn = fmax(shares[3], shares[0] / asked->tolerance);
    double bend = fmax(asked->more[0] * shares[4], shares[1] / asked->tolerance);
    double twist = fmax(asked->more[1] * shares[5], shares[2] / asked->tolerance);
    double moves[2];
    unit = 1.0;
    for (index_t order = 0; order < 2; order++) {
        unit *= period;
        double most = fmax(found->of.moved_on_records[order],
                           found->of.moved[order] / (asked->tolerance * asked->tolerance));
        moves[order] = sqrt(most) / unit / asked->move_limits.v[order];
    }
    double moved = fmax(moves[0], sqrt(moves[1]));
    double factor = fmax(fmax(turn, sqrt(bend)), asked->step > 0.0 ? sqrt(twist) : cbrt(twist));
    return fmax(factor, moved);
}

typedef struct { index_t first, last, final; bool with_axes; } range_t;

static index_t record_of(double place, index_t final) {
    return place > 0.0 ? place < (double)final ? (index_t)place : final : 0;
}

/* Add the records around a spot to those before, or look at these first if they are far apart. */
static void add_spot(const even_t *asked, range_t *range, double begin, double end,
                     largest_t *found, scratch_t *scratch) {
    index_t first = most(record_of(floor(begin * (double)range->final), range->final) - MARGIN, 0);
    index_t last = record_of(ceil(end * (double)range->final), range->final);
    last = most(least(last + MARGIN, range->final), first);
    if (range->last >= 0 && first > range->last + GAP) {
        see_records(asked, range->first, range->last, range->final, range->with_axes, found, scratch);
        range->last = -1;
    }
    range->first = range->last < 0 ? first : least(range->first, first);
    range->last = most(range->last, last);
}

/* Return the factor by which a motion with this number of cycles should take longer. */
static double look(const even_t *asked, survey_t *survey, index_t cycles, scratch_t *scratch) {
    largest_t found = {.left = scratch->left};
    double duration = asked->knots.v[asked->knots.n - 1];
    bool is_short = cycles < SHORT && !asked->has_one_shape;
    range_t range = {0, -1, cycles, has_axes(asked->limits)};
    if (asked->is_everywhere || is_short)
        range.last = cycles;
    else {
        /* If the acceleration is continuous with a hold, the ends are as smooth as the rest. */
        bool is_held = asked->is_held[0] && asked->is_held[1];
        bool with_ends = !(asked->has_one_shape && asked->step == 0.0 && is_held);
        index_t reach = asked->has_one_shape ? 0 : least(END_KNOTS, asked->knots.n - 1);
        double hot = HOT * survey->largest;
        if (with_ends)
            add_spot(asked, &range, 0.0, asked->knots.v[reach] / duration, &found, scratch);
        for (index_t i = 0; i < survey->n; i++)
            if (survey->factors[i] >= hot)
                add_spot(asked, &range, survey->instants[most(i - 1, 0)] / duration,
                         survey->instants[least(i + 1, survey->n - 1)] / duration, &found, scratch);
        if (with_ends)
            add_spot(asked, &range, asked->knots.v[asked->knots.n - 1 - reach] / duration, 1.0,
                     &found, scratch);
    }
    see_records(asked, range.first, range.last, cycles, range.with_axes, &found, scratch);
    scratch->left = found.left;
    double factor = found.left < 0 ? INFINITY : excess_of(asked, &found);
    if (asked->step == 0.0)
        return factor;
    /* The effect of an acceleration step on the records depends on its place between them.  The
     * search needs a factor that depends smoothly on the duration. */
    double largest = survey->largest;
    weigh_looks(asked, asked->period * (double)cycles / duration, survey, scratch);
    factor = fmax(factor, survey->largest);
    weigh_looks(asked, 1.0, survey, scratch);
    survey->largest = largest;
    return factor;
}

static void search(const even_t *asked, survey_t *survey, index_t cycles, index_t low, index_t high,
                   even_pace_t *found, scratch_t *scratch) {
    index_t beyond = high;
    for (int attempt = 0; attempt < MOST_ATTEMPTS; attempt++) {
        found->factor = look(asked, survey, cycles, scratch);
        if (found->factor <= 1.0) {
            high = cycles;
            if (found->factor >= 1.0 - PRECISION)
                break;
        } else
            low = cycles;
        if (!(found->factor < INFINITY))
            break;
        if ((double)(high - low) <= fmax(1.0, PRECISION * (double)high))
            break;
        double factor = fmin(found->factor, LARGEST_FACTOR) * (1.0 + 0.5 * PRECISION);
        double guess = (double)cycles * factor;
        if (attempt >= MOST_PREDICTIONS && high < beyond)
            guess = sqrt((double)most(low, 1) * (double)high);
        cycles = (index_t)fmin(fmax(ceil(guess), (double)(low + 1)), (double)(high - 1));
    }
    found->cycles = high < beyond ? high : 0;
}

int time_even(const even_t *asked, index_t first, index_t least_cycles, index_t most_cycles,
              even_pace_t *found) {
    double duration = asked->knots.v[asked->knots.n - 1];
    index_t room = LOOKS * (asked->knots.n + asked->move_breaks.n + FEWEST_PIECES + 1);
    survey_t survey = {.instants = malloc((size_t)(2 * room) * sizeof(double))};
    scratch_t *scratch = malloc(sizeof *scratch);
    bool is_there = survey.instants != NULL && scratch != NULL;
    *found = (even_pace_t){0, INFINITY, INFINITY};
    if (is_there) {
        survey.factors = survey.instants + room;
        survey.n = place_looks(asked, survey.instants);
        weigh_looks(asked, 1.0, &survey, scratch);
        found->coarse = survey.largest;
        double guess = ceil(duration * survey.largest / asked->period), cycles = (double)first;
        /* Instants and records agree but for a few percent where the shape is the same. */
        if (!first || (asked->has_one_shape && least_cycles < most_cycles))
            cycles = fmin(fmax(cycles, guess / FAR), FAR * guess);
        scratch->left = MOST_RECORDS;
        if (most_cycles >= least_cycles && guess < FAR * (double)most_cycles) {
            index_t begin = (index_t)fmin(fmax(cycles, (double)least_cycles), (double)most_cycles);
            search(asked, &survey, begin, least_cycles - 1, most_cycles + 1, found, scratch);
        } else
            found->factor = guess / (double)most_cycles;
    }
    free(scratch), free(survey.instants);
    return is_there ? 0 : OUT_OF_MEMORY;
}
