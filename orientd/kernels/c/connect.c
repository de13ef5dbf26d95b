/* The way from one state to another: the connector that is found, made as short as the limits
 * permit, after the acceleration has fallen if it has to. */
#include <string.h>

#include "shorten.h"

enum {
    FALLS = 2,    /* ramps in which an acceleration falls, at most */
    GUESSES = 5,
    GUESSES_FROM_STEADY = 3,  /* where nothing accelerates at the beginning */
};

/* Rates at the ends, and durations, of guesses, as shares: see guess_connector. */
static const double guesses[GUESSES][2] = {
    {1.0, 0.6}, {0.0, 1.3}, {1.0, 1.0}, {1.0, 0.25}, {1.0, 0.0},
};

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

/* Write the shortest connector and return whether there is one. */
static bool put_connector(const motion_t *start, const motion_t *end, matrix_t limits, double period,
                          double least, double longest, double most_turn, double ease,
                          bool as_found, joins_t *best) {
    joins_t shorter;
    views_t room = views_of(&shorter, ELEMENTS);
    single_t found;
    best->count = 0;
    bool is_join = find_join(start, end, limits, period, least, most_turn, &found);
    /* There may be several that are shorter than all near them. */
    int count = norm(start->alpha) > 0.0 ? GUESSES : GUESSES_FROM_STEADY;
    for (int k = 0; k < count && !(as_found && is_join); k++) {
        single_t guess = guess_join(start, end, limits, period, least, guesses[k][0], guesses[k][1]);
        shorter.count = shorten_connector(start, end, limits, period, least, most_turn,
                                          LONGER * guess.total, ease, &guess, room.q, room.w,
                                          room.breaks);
        if (shorter.count && !(best->count && end_of(best) <= end_of(&shorter)))
            *best = shorter;
    }
    if (is_join && !(best->count && end_of(best) <= found.total)) {
        best->count = 1;
        put_quat(best->q, start->q);
        for (int k = 0; k < FACTORS; k++)
            put_vec(best->w + 3 * k, found.w[k]);
        best->breaks[0] = 0.0, best->breaks[1] = found.total;
    }
    return best->count && end_of(best) <= longest;
}

/* Whether an acceleration that goes on would take the velocity beyond its limit. */
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
        ramps_t ramps = ramps_from(state, within, &bounds, period);
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
    motion_t state = state_at(start.v), goal = state_at(end.v);
    bool is_direct = !falls_first && put_connector(&state, &goal, limits, period, least, longest,
                                                   most_turn, ease, as_found, &direct);
    put_falls(&state, own, period, falls_first, &falls);
    if (falls.count) {
        double begin = end_of(&falls);
        bool is_found = put_connector(&state, &goal, limits, period, least - begin, longest,
                                      most_turn, ease, as_found, &onward);
        if (is_found && !(is_direct && end_of(&direct) <= begin + end_of(&onward))) {
            index_t count = put_behind(&falls, 0, q, w, breaks);
            return put_behind(&onward, count, q, w, breaks);
        }
    }
    return is_direct ? put_behind(&direct, 0, q, w, breaks) : 0;
}
