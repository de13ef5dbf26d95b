/* The way from one state to another: the connector that is found, made as short as the limits
 * permit, after the acceleration has fallen if it has to. */
#include <string.h>

#include "shorten.h"

enum {
    FALLS = 2,    /* ramps in which an acceleration falls, at most */
    GUESSES = 2,
};

/* Rates at the ends, and durations, of guesses, as shares: see guess_connector. */
static const double guesses[GUESSES][2] = {{1.0, 0.6}, {0.0, 1.3}};

#define LONGER 8.0        /* times a guess of how long a connector takes */
#define VERGE 0.99        /* of the velocity: what rises beyond has to let its acceleration fall */
#define FALL 0.999        /* of acceleration and jerk, with which it falls */
#define STILL 1e-6        /* of the velocity: what rises by less has no acceleration to speak of */

/* Joins end to end, signs continuous. */
typedef struct {
    index_t count;
    double q[4 * ELEMENTS], w[3 * FACTORS * ELEMENTS], breaks[ELEMENTS + 1];
} joins_t;

typedef struct { matrix_t q; tensor_t w; row_t breaks; } views_t;

static views_t views_of(joins_t *joins, index_t n) {
    return (views_t){{joins->q, n, 4}, {joins->w, n, FACTORS, 3}, {joins->breaks, n + 1}};
}

static double end_of(const joins_t *joins) { return joins->breaks[joins->count]; }

/* Leave out what takes no time of a connector of three parts. */
static void drop_empty(joins_t *joins) {
    index_t count = 0;
    for (index_t i = 0; i < joins->count; i++) {
        if (joins->breaks[i] == joins->breaks[i + 1])
            continue;
        memmove(joins->q + 4 * count, joins->q + 4 * i, 4 * sizeof(double));
        memmove(joins->w + 3 * FACTORS * count, joins->w + 3 * FACTORS * i,
                3 * FACTORS * sizeof(double));
        joins->breaks[++count] = joins->breaks[i + 1];
    }
    joins->count = count;
}

/* Write the shortest connector and return whether there is one. */
static bool put_connector(row_t start, row_t end, matrix_t limits, double period, double least,
                          double longest, double most_turn, double ease, bool as_found,
                          joins_t *best) {
    joins_t found, shorter;
    views_t first = views_of(&found, 3), room = views_of(&shorter, ELEMENTS);
    best->count = found.count = 0;
    if (find_connector(start, end, limits, period, least, most_turn, first.q, first.w,
                       first.breaks)) {
        found.count = 3;
        if (!(end_of(&found) <= longest))
            return false;
        if (!as_found) {
            shorter.count = shorten_connector(start, end, limits, period, least, most_turn,
                                              end_of(&found) - period, ease, first.q, first.w,
                                              first.breaks, room.q, room.w, room.breaks);
            if (shorter.count && end_of(&shorter) < end_of(&found))
                *best = shorter;
        }
    }
    /* With limits of axes there may be several that are shorter than all near them. */
    bool has_axes = false;
    for (int order = 0; order < 3; order++)
        for (int k = 1; k < 4; k++)
            has_axes |= row_of(limits, order)[k] < INFINITY;
    for (int k = 0; k < GUESSES && !as_found && (has_axes || !best->count); k++) {
        joins_t guess;
        views_t of = views_of(&guess, 3);
        guess.count = 3;
        guess_connector(start, end, limits, period, least, guesses[k][0], guesses[k][1], of.q,
                        of.w, of.breaks);
        shorter.count = shorten_connector(start, end, limits, period, least, most_turn,
                                          LONGER * end_of(&guess), ease, of.q, of.w, of.breaks,
                                          room.q, room.w, room.breaks);
        bool is_longer = found.count && end_of(&shorter) >= end_of(&found);
        if (shorter.count && !is_longer && !(best->count && end_of(best) <= end_of(&shorter)))
            *best = shorter;
    }
    if (!best->count && found.count) {
        drop_empty(&found);
        *best = found;
    }
    return best->count && end_of(best) <= longest;
}

/* Whether the velocity would exceed its limit if the acceleration continued. */
static bool has_to_fall(const motion_t *state, matrix_t limits) {
    double duration = 0.0;
    for (int k = 0; k < 4; k++)
        duration = fmax(duration, size_of(state->alpha, k) / row_of(limits, 2)[k]);
    vec_t after = scaled_plus(0.5 * duration, state->alpha, state->omega);
    for (int k = 0; k < 4; k++) {
        double most = row_of(limits, 0)[k];
        if (size_of(after, k) / most > fmax(VERGE, size_of(state->omega, k) / most + STILL))
            return true;
    }
    return false;
}

/* Write the ramps in which an acceleration falls that has to, and the state they lead to.
 *
 * What rises to a limit of its velocity with all of the jerk has to let the acceleration fall at
 * once, since no join that bends a little later keeps that limit.  Whole periods at that jerk may
 * leave a little of it, which one more takes away. */
static void put_falls(motion_t *state, matrix_t limits, double period, bool is_wanted,
                      joins_t *falls) {
    double table[12];
    matrix_t within = {table, 3, 4};
    for (int i = 0; i < 12; i++)
        table[i] = (i < 4 ? 1.0 : FALL) * limits.v[i];
    falls->count = 0, falls->breaks[0] = 0.0;
    while (falls->count < FALLS && (is_wanted || has_to_fall(state, limits))) {
        bounds_t bounds = bounds_of(state, state, within);
        ramps_t ramps = ramps_from(state, vec(0.0, 0.0, 0.0), within, &bounds, period, true);
        int one = 0;
        while (one < ramps.count && !(ramps.durations[one] > 0.0))
            one++;
        if (one == ramps.count)
            return;
        vec_t w[FACTORS];
        put_increments(state, &ramps.ends[one], ramps.durations[one], w);
        put_quat(falls->q + 4 * falls->count, state->q);
        for (int k = 0; k < FACTORS; k++)
            put_vec(falls->w + 3 * (FACTORS * falls->count + k), w[k]);
        falls->breaks[falls->count + 1] = end_of(falls) + ramps.durations[one];
        falls->count++;
        *state = ramps.ends[one];
        is_wanted = false;
    }
}

/* Write joins behind others, and return how many there are then. */
static index_t put_behind(const joins_t *joins, index_t count, matrix_t q, tensor_t w,
                          row_t breaks) {
    double since = count ? breaks.v[count] : 0.0;
    memcpy(row_of(q, count), joins->q, sizeof(double) * 4 * (size_t)joins->count);
    memcpy(w.v + 3 * FACTORS * count, joins->w,
           sizeof(double) * 3 * FACTORS * (size_t)joins->count);
    for (index_t i = 0; i <= joins->count; i++)
        breaks.v[count + i] = since + joins->breaks[i];
    return count + joins->count;
}

index_t connect_states(row_t start, row_t end, matrix_t limits, matrix_t own, double period,
                       double least, double longest, double most_turn, double ease, bool as_found,
                       bool falls_first, matrix_t q, tensor_t w, row_t breaks) {
    joins_t direct, falls, onward;
    bool is_direct = !falls_first && put_connector(start, end, limits, period, least, longest,
                                                   most_turn, ease, as_found, &direct);
    motion_t state = state_at(start.v);
    put_falls(&state, own, period, falls_first, &falls);
    if (falls.count) {
        double row[STATE], begin = end_of(&falls);
        put_state(row, state);
        bool is_found = put_connector((row_t){row, STATE}, end, limits, period, least - begin,
                                      longest, most_turn, ease, as_found, &onward);
        if (is_found && !(is_direct && end_of(&direct) <= begin + end_of(&onward))) {
            index_t count = put_behind(&falls, 0, q, w, breaks);
            return put_behind(&onward, count, q, w, breaks);
        }
    }
    return is_direct ? put_behind(&direct, 0, q, w, breaks) : 0;
}
