/* The quickest stop of three phases of constant jerk, and the way by rest from one state to another.
 *
 * Of a stop the last two phases are about one axis e: the acceleration is held at -p e, and then
 * falls to zero.  Before that it goes from alpha to -p e in a time t, by a constant jerk, so that
 *
 *     omega + t (alpha - p e) / 2 = e (p t_2 + p^2 / 2 J).
 *
 * So e is the direction of omega + t alpha / 2, and p follows from its length.  That leaves one
 * number, t = |alpha + p e| / J, which lies between two that bound it.  The accelerations are on
 * chords between those at the ends, so that they keep any convex limits.
 */
#include <stdlib.h>
#include <string.h>

#include "connectors.h"
#include "double_s.h"
#include "quintic.h"
#include "trajectory.h"

#define STILL 1e-12        /* rad/s and rad, that count as none */
#define SHORTEST 1e-8      /* s, of a phase */
#define LONGEST_PART 0.9   /* rad, of a piece about one axis */
#define BENT_PART 0.1      /* rad, of one that is not */

#define WHOLE 1e-9         /* of a period, and of a phase */

enum { STEPS = 60 };

typedef struct { vec_t line; double pull, times[3]; } stop_t;

double parts_of(vec_t first, vec_t last, double duration, double part) {
    return ceil(fmax(duration * fmax(norm(first), norm(last)) / part, 1.0));
}

/* About a constant axis, or else by Magnus' expansion of fourth order (Blanes et al. 2009, eq. 254). */
bool add_parts(phases_t *to, vec_t omega, vec_t alpha, double duration, double bent_part) {
    motion_t from = to->node[to->count - 1];
    vec_t jerk = times(1.0 / duration, minus(alpha, from.alpha));
    vec_t bend = plus(cross(from.omega, from.alpha), cross(from.omega, jerk));
    bool is_bent = norm(bend) > STILL;
    double parts = parts_of(from.omega, omega, duration, is_bent ? bent_part : LONGEST_PART);
    if (!(to->count + parts <= MOST_NODES))
        return false;
    if (to->count + (index_t)parts > to->room) {
        index_t room = 2 * to->room + (index_t)parts;
        motion_t *node = realloc(to->node, (size_t)room * sizeof *node);
        to->node = node ? node : to->node;
        double *time = node ? realloc(to->time, (size_t)room * sizeof *time) : NULL;
        to->time = time ? time : to->time;
        if (time == NULL)
            return false;
        to->room = room;
    }
    double begun = to->time[to->count - 1], h = duration / parts, gauss = sqrt(3.0) / 6.0;
    quat_t q = from.q;
    for (index_t k = 1; k <= (index_t)parts; k++) {
        double t[3] = {(k - 0.5 - gauss) * h, (k - 0.5 + gauss) * h, k * h};
        vec_t v[3];
        for (int i = 0; i < 3; i++)
            v[i] = scaled_plus(t[i], scaled_plus(0.5 * t[i], jerk, from.alpha), from.omega);
        vec_t half = scaled_plus(sqrt(3.0) / 24.0 * h * h, cross(v[0], v[1]),
                                 times(0.25 * h, plus(v[0], v[1])));
        q = multiplied(q, exponential(half));
        bool is_last = k == (index_t)parts;
        to->time[to->count] = is_last ? begun + duration : begun + t[2];
        to->node[to->count++] = (motion_t){q, is_last ? omega : v[2],
                                           is_last ? alpha : scaled_plus(t[2], jerk, from.alpha)};
    }
    return true;
}

static bool add_phase(phases_t *to, vec_t omega, vec_t alpha, double duration) {
    return add_parts(to, omega, alpha, duration, BENT_PART);
}

static double along(const double most[4], vec_t line) {
    double least = fmin(most[1] / fabs(line.x), fmin(most[2] / fabs(line.y), most[3] / fabs(line.z)));
    return fmin(most[0], least);
}

static double takes(vec_t change, const double jerk[4]) {
    return fmax(fmax(norm(change) / jerk[0], fabs(change.x) / jerk[1]),
                fmax(fabs(change.y) / jerk[2], fabs(change.z) / jerk[3]));
}

/* The stop whose first phase takes a time, and how long that phase would have to take. */
static double stop_after(const motion_t *state, double rise, matrix_t limits, double share,
                         stop_t *stop) {
    vec_t left = scaled_plus(0.5 * rise, state->alpha, state->omega);
    double size = norm(left), push = norm(state->alpha);
    vec_t line = size > STILL ? times(1.0 / size, left)
               : push > 0.0 ? times(-1.0 / push, state->alpha) : vec(1.0, 0.0, 0.0);
    double most = share * along(row_of(limits, 1), line);
    double jerk = share * along(row_of(limits, 2), line);
    double pull = size / (0.25 * rise + sqrt(rise * rise / 16.0 + 0.5 * size / jerk));
    pull = size > STILL ? fmin(pull, most) : 0.0;
    double hold = pull > 0.0 ? size / pull - 0.5 * pull / jerk - 0.5 * rise : 0.0;
    *stop = (stop_t){line, pull, {rise, fmax(hold, 0.0), pull / jerk}};
    return takes(scaled_plus(pull, line, state->alpha), row_of(limits, 2)) / share;
}

/* Halve a bracket of a root, or shrink it by the false position (Dowell and Jarratt 1971). */
typedef struct { double low, high, below, above; int side; } bracket_t;

static double next_of(const bracket_t *b, int step) {
    double middle = 0.5 * (b->low + b->high);
    double found = (b->low * b->above - b->high * b->below) / (b->above - b->below);
    return step % 4 < 3 && found > b->low && found < b->high ? found : middle;
}

static void shrink(bracket_t *b, double at, double value) {
    int side = value > 0.0 ? 1 : -1;
    if (side > 0)
        b->low = at, b->below = value, b->above *= b->side == side ? 0.5 : 1.0;
    else
        b->high = at, b->above = value, b->below *= b->side == side ? 0.5 : 1.0;
    b->side = side;
}

static double find_stop(const motion_t *state, matrix_t limits, double share, stop_t *stop) {
    const double *jerk = row_of(limits, 2), *most = row_of(limits, 1);
    double least = fmin(fmin(jerk[0], jerk[1]), fmin(jerk[2], jerk[3]));
    double high = (norm(state->alpha) + share * most[0]) / (share * least), at = high;
    bracket_t b = {0.0, high, stop_after(state, 0.0, limits, share, stop), 0.0, 0};
    b.above = stop_after(state, high, limits, share, stop) - high;
    for (int k = 0; k < STEPS && b.high - b.low > 1e-16 * b.high && b.above < 0.0; k++) {
        at = next_of(&b, k);
        double wrong = stop_after(state, at, limits, share, stop) - at;
        if (wrong == 0.0)
            break;
        shrink(&b, at, wrong);
    }
    stop_after(state, at, limits, share, stop);
    if (stop->times[1] < WHOLE * stop->times[0])
        stop->times[1] = 0.0;
    return stop->times[0] + stop->times[1] + stop->times[2];
}

bool add_stop(const motion_t *state, matrix_t limits, double period, double longest,
              phases_t *to) {
    double moves = norm(state->omega) + norm(state->alpha);
    if (moves < STILL)
        return true;
    stop_t stop;
    /* It may be no number. */
    if (!(moves < INFINITY))
        return false;
    double took = find_stop(state, limits, 1.0, &stop);
    if (!(took <= longest))
        return false;
    double goal = period > 0.0 ? ceil(took / period - WHOLE) * period : took;
    if (goal > took) {
        /* A little less of the limits, so that it takes whole periods. */
        bracket_t b = {0.5 * took / goal, 1.0, 0.0, took - goal, 0};
        while ((b.below = find_stop(state, limits, b.low, &stop) - goal) <= 0.0)
            b.low *= 0.5;
        for (int k = 0; k < STEPS && b.high - b.low > 1e-15; k++) {
            double share = next_of(&b, k), wrong = find_stop(state, limits, share, &stop) - goal;
            if (fabs(wrong) < 1e-14 * goal)
                break;
            shrink(&b, share, wrong);
        }
    }
    vec_t zero = vec(0.0, 0.0, 0.0), pulled = times(-stop.pull, stop.line);
    double rest = 0.5 * stop.pull * stop.times[2];
    vec_t held = times(rest + stop.pull * stop.times[1], stop.line), last = times(rest, stop.line);
    vec_t omegas[3] = {held, last, zero}, alphas[3] = {pulled, pulled, zero};
    double more = 0.0;
    bool is_done = true;
    for (int k = 0; k < 3 && is_done; k++) {
        /* A phase without a duration is left to the next one. */
        more += stop.times[k];
        if (more < SHORTEST)
            continue;
        is_done = add_phase(to, omegas[k], alphas[k], more);
        more = 0.0;
    }
    to->node[to->count - 1].omega = to->node[to->count - 1].alpha = zero;
    if (period > 0.0)
        to->time[to->count - 1] = goal;
    return is_done;
}

/* Add the turn from rest to rest, and a time more, s. */
static bool add_turn(quat_t goal, matrix_t limits, double more, phases_t *to) {
    vec_t zero = vec(0.0, 0.0, 0.0), way = times(2.0, logarithm(shorter(
        multiplied(conjugated(to->node[to->count - 1].q), goal))));
    double angle = norm(way), t[3];
    if (!(angle > 10.0 * STILL))
        return more <= 0.0 || add_phase(to, zero, zero, more);
    vec_t axis = times(1.0 / angle, way);
    double v = along(row_of(limits, 0), axis);
    double_s(angle, v, along(row_of(limits, 1), axis), along(row_of(limits, 2), axis), t);
    double took = 4.0 * t[0] + 2.0 * t[1] + t[2], slower = (took + more) / took;
    t[0] *= slower, t[1] *= slower, t[2] *= slower;
    double pull = angle / ((t[0] + t[1]) * (2.0 * t[0] + t[1] + t[2]));
    double rates[7] = {0.5 * pull * t[0], 0.5 * pull * t[0] + pull * t[1], pull * (t[0] + t[1]),
                       pull * (t[0] + t[1]), 0.5 * pull * t[0] + pull * t[1], 0.5 * pull * t[0], 0.0};
    double pulls[7] = {pull, pull, 0.0, 0.0, -pull, -pull, 0.0};
    double last[7] = {t[0], t[1], t[0], t[2], t[0], t[1], t[0]};
    for (int k = 0; k < 7; k++)
        if (last[k] > 0.0 && !add_phase(to, times(rates[k], axis), times(pulls[k], axis), last[k]))
            return false;
    to->node[to->count - 1].omega = to->node[to->count - 1].alpha = zero;
    return true;
}

bool new_phases(motion_t state, phases_t *to) {
    *to = (phases_t){malloc(64 * sizeof(motion_t)), malloc(64 * sizeof(double)), 1, 64};
    if (to->node == NULL || to->time == NULL)
        return false;
    to->node[0] = state, to->time[0] = 0.0;
    return true;
}

void free_phases(phases_t *phases) { free(phases->node), free(phases->time); }

bool by_way_of_rest(const motion_t *start, const motion_t *end, matrix_t limits, matrix_t own,
                    double period, double least, double longest, phases_t *to) {
    phases_t run_up;
    motion_t mirrored = {end->q, times(-1.0, end->omega), end->alpha};
    bool is_done = new_phases(mirrored, &run_up) && add_stop(start, own, 0.0, longest, to)
                && add_stop(&mirrored, limits, 0.0, longest, &run_up);
    if (is_done) {
        index_t count = to->count;
        quat_t goal = run_up.node[run_up.count - 1].q;
        double after = run_up.time[run_up.count - 1];
        is_done = add_turn(goal, limits, 0.0, to);
        if (is_done) {
            double took = to->time[to->count - 1] + after;
            double total = fmax(fmax(ceil(fmax(took, least) / period - WHOLE), 1.0) * period, took);
            to->count = count;
            is_done = total <= longest && add_turn(goal, limits, fmax(total - took, 0.0), to);
        }
        double begun = to->time[to->count - 1];
        motion_t rest = to->node[to->count - 1];
        bool is_other = rest.q.w * goal.w + rest.q.x * goal.x + rest.q.y * goal.y
                      + rest.q.z * goal.z < 0.0;
        for (index_t k = run_up.count - 2; is_done && k >= 0; k--) {
            motion_t node = run_up.node[k];
            double h = run_up.time[k + 1] - run_up.time[k];
            is_done = add_phase(to, times(-1.0, node.omega), node.alpha, h);
            to->time[to->count - 1] = begun + after - run_up.time[k];
            to->node[to->count - 1].q = is_other ? opposite(node.q) : node.q;
        }
        if (run_up.count > 1)
            to->node[to->count - 1].omega = end->omega, to->node[to->count - 1].alpha = end->alpha;
    }
    free_phases(&run_up);
    return is_done;
}

/* Write a piece whose rotation vector has degree five, with given states at its ends. */
static void put_piece(const motion_t *from, const motion_t *to, double duration, double *piece) {
    double ends[2][3][3] = {0}, *c = piece + 4;
    vec_t way[2] = {vec(0.0, 0.0, 0.0), rotation_vector(from->q, to->q)}, rate, change;
    for (int side = 0; side < 2; side++) {
        const motion_t *at = side ? to : from;
        put_rates(way[side], at->omega, at->alpha, 0.5 * duration, &rate, &change);
        const double of[3][3] = {{way[side].x, rate.x, change.x}, {way[side].y, rate.y, change.y},
                                 {way[side].z, rate.z, change.z}};
        memcpy(ends[side], of, sizeof of);
    }
    put_quat(piece, from->q);
    memset(c, 0, 3 * NODES * sizeof *c);
    for (int axis = 0; axis < 3; axis++) {
        put_quintic(2.0, ends[0][axis], ends[1][axis], c + axis, 3);
        /* By powers of u, which begins at -1. */
        for (int k = 0; k < QUINTIC - 1; k++)
            for (int j = QUINTIC - 2; j >= k; j--)
                c[3 * j + axis] += c[3 * j + 3 + axis];
    }
}

index_t put_phases(const phases_t *phases, row_t breaks, matrix_t pieces) {
    index_t count = phases->count - 1;
    breaks.v[0] = 0.0;
    for (index_t k = 0; k < count && count <= pieces.n; k++) {
        double duration = phases->time[k + 1] - phases->time[k];
        put_piece(&phases->node[k], &phases->node[k + 1], duration, row_of(pieces, k));
        breaks.v[k + 1] = phases->time[k + 1];
    }
    return count;
}

index_t stop_from(row_t state, matrix_t limits, double period, double longest, row_t breaks,
                  matrix_t pieces) {
    phases_t phases;
    motion_t begin = state_at(state.v);
    index_t count = 0;
    if (new_phases(begin, &phases) && add_stop(&begin, limits, period, longest, &phases))
        count = put_phases(&phases, breaks, pieces);
    free_phases(&phases);
    return count;
}
