/* Search for the shortest connector: all ramps with a grid of durations, then those near the best.
 *
 * A connector is a quintic join with, where that is quicker or needed, a ramp before it and one
 * behind.  Without a ramp a quintic that begins with a large acceleration keeps some of it for
 * long, and may not keep the limit of the velocity for any duration.  Durations are looked at one
 * after the other until enough joins seem to keep their bounds; of those the shortest are held
 * against them at more points of the curve itself.
 */
#include "connectors.h"

enum {
    GRID = 16,     /* durations of the first look */
    REFINED = 12,  /* durations of the second look */
    BEST = 6,      /* connectors that are measured first */
    LONGER = 6,    /* how often, each a little longer */
    PAIRS = RAMPS * RAMPS,
    SEEN = 2 * GRID * PAIRS,
    SEEN_AGAIN = 2 * REFINED * BEST,
    PARTS_OF_TURN = 6,  /* of a join, in which its velocity is integrated */
};

/* How much longer those may be. */
static const double longer[LONGER] = {1.0, 1.004, 1.012, 1.03, 1.07, 1.15};

/* Of a join between two ramps, s. */
#define SHORTEST 1e-6

/* A connector to try: the pair of ramps numbered row by row, and the way round, 0 the shorter. */
typedef struct { double total; int pair, way; } try_t;

typedef struct {
    ramps_t into, out_of;
    bounds_t bounds;
    points_t points;
    double period, least, most_turn;
    vec_t into_turn[RAMPS], out_of_turn[RAMPS];  /* what the ramps turn by, rad */
    int pairs[PAIRS];
    double totals[GRID];
    try_t found[SEEN], again[SEEN_AGAIN], tries[SEEN + SEEN_AGAIN];
} search_t;

/* The component with the least bound. */
static double least_of(const double most[4]) {
    return fmin(fmin(most[0], most[1]), fmin(most[2], most[3]));
}

/* Add a duration in whole periods unless it is there already, and return how many there are. */
static int add_total(double duration, double period, int count, double *totals) {
    double total = ceil(duration / period - 1e-9) * period;
    if (count && total == totals[count - 1])
        return count;
    totals[count] = total;
    return count + 1;
}

/* Write durations from too short to long enough, and return how many there are. */
static int put_grid(const motion_t *start, const motion_t *end, double angle, search_t *search) {
    const bounds_t *bounds = &search->bounds;
    double velocity = least_of(bounds->most[0]), acceleration = least_of(bounds->most[1]);
    double jerk = least_of(bounds->most[2]), period = search->period;
    double change = norm(minus(end->omega, start->omega));
    double speeds = norm(start->omega) + norm(end->omega);
    double sizes = norm(start->alpha) + norm(end->alpha);
    double shortest = fmax(0.5 * angle / bounds->most[0][0], sqrt(angle / bounds->most[1][0]));
    shortest = fmax(fmax(shortest, change / bounds->most[1][0]), fmax(period, search->least));
    double longest = 2.0 * angle / velocity + 3.0 * sqrt(angle / acceleration)
                   + 5.0 * cbrt(angle / jerk) + 5.0 * speeds / acceleration
                   + 8.0 * sqrt(speeds / jerk) + 12.0 * sizes / jerk + 8.0 * period;
    longest = fmax(fmax(longest, 3.0 * search->least), shortest);
    double step = log(longest / shortest) / (GRID - 1);
    int count = 0;
    for (int k = 0; k < GRID; k++)
        count = add_total(shortest * exp(step * k), period, count, search->totals);
    return count;
}

/* Write durations from the one before the best up to that, and return how many there are. */
static int put_refined(double best, double step, const search_t *search, double *totals) {
    int count = 0;
    for (int k = REFINED - 1; k >= 0; k--) {
        double duration = best * pow(step, -k / (double)(REFINED - 1));
        if (duration >= search->least - 1e-9)
            count = add_total(duration, search->period, count, totals);
    }
    return count;
}

/* Duration of the join between a pair of ramps. */
INLINE double between_ramps(const search_t *search, double total, int pair) {
    return total - (search->into.durations[pair / search->out_of.count]
                    + search->out_of.durations[pair % search->out_of.count]);
}

/* Write the increments of the join of a pair but the middle one, and return that quaternion. */
INLINE quat_t put_outer(const search_t *search, int pair, double duration, vec_t w[FACTORS]) {
    return put_outer_increments(&search->into.ends[pair / search->out_of.count],
                                &search->out_of.ends[pair % search->out_of.count], duration, w);
}

/* The integral of the angular velocity over a ramp, whose jerk is constant. */
static vec_t turn_of_ramp(motion_t from, motion_t to, double duration) {
    vec_t turn = times(0.5 * duration, plus(from.omega, to.omega));
    return scaled_plus(duration * duration / 12.0, minus(from.alpha, to.alpha), turn);
}

/* The integral of the angular velocity over a join, by Simpson's rule. */
static vec_t turn_of_join(const vec_t w[FACTORS]) {
    join_t join = join_of(w, 1.0);
    vec_t turn = vec(0.0, 0.0, 0.0);
    for (int k = 0; k <= PARTS_OF_TURN; k++) {
        double share = k == 0 || k == PARTS_OF_TURN ? 1.0 : k % 2 ? 4.0 : 2.0;
        motion_t here = join_at(quat(1.0, 0.0, 0.0, 0.0), &join,
                                join_basis(k / (double)PARTS_OF_TURN));
        turn = scaled_plus(share / (3.0 * PARTS_OF_TURN), here.omega, turn);
    }
    return turn;
}

/* Whether a connector turns no further than it may. */
static bool turns_little(const search_t *search, int pair, const vec_t w[FACTORS]) {
    vec_t ramps = plus(search->into_turn[pair / search->out_of.count],
                       search->out_of_turn[pair % search->out_of.count]);
    double longest = norm(ramps);
    for (int k = 0; k < FACTORS; k++)
        longest += 2.0 * norm(w[k]);
    return longest <= search->most_turn
        || norm(plus(ramps, turn_of_join(w))) <= search->most_turn;
}

/* Add the connectors of a duration that seem to keep the bounds, and return how many there are. */
static int add_seen(const search_t *search, const int *pairs, int count_of_pairs, double total,
                    try_t *found, int count) {
    bool longer_way[PAIRS];
    vec_t w[FACTORS];
    for (int i = 0; i < count_of_pairs; i++) {
        longer_way[i] = false;
        double h = between_ramps(search, total, pairs[i]);
        if (!(h > SHORTEST))
            continue;
        quat_t middle = put_outer(search, pairs[i], h, w);
        w[2] = logarithm(middle);
        if (seems_to_keep(w, h, &search->points, &search->bounds)
            && turns_little(search, pairs[i], w))
            found[count++] = (try_t){total, pairs[i], 0};
        w[2] = logarithm(opposite(middle));
        longer_way[i] = seems_to_keep(w, h, &search->points, &search->bounds)
                     && turns_little(search, pairs[i], w);
    }
    for (int i = 0; i < count_of_pairs; i++)
        if (longer_way[i])
            found[count++] = (try_t){total, pairs[i], 1};
    return count;
}

/* Write the pairs of some connectors, each once and in order, and return how many there are. */
static int put_pairs(const try_t *found, int count, int *pairs) {
    int many = 0;
    for (int i = 0; i < count; i++) {
        int place = 0;
        while (place < many && pairs[place] < found[i].pair)
            place++;
        if (place < many && pairs[place] == found[i].pair)
            continue;
        for (int k = many++; k > place; k--)
            pairs[k] = pairs[k - 1];
        pairs[place] = found[i].pair;
    }
    return many;
}

/* Write the first of two lists in order of duration, at most so many; return how many. */
static int merge(const try_t *found, int count, const try_t *again, int count_again, try_t *both,
                 int most) {
    int i = 0, j = 0;
    while (i + j < most && (i < count || j < count_again)) {
        bool is_first = j == count_again || (i < count && found[i].total <= again[j].total);
        both[i + j] = is_first ? found[i] : again[j];
        if (is_first)
            i++;
        else
            j++;
    }
    return i + j;
}

/* Write connectors again with durations a little longer, too, the shortest first. */
static int put_longer(const try_t *near, int count, double period, try_t *tries) {
    int many = 0;
    for (int i = 0; i < count; i++)
        for (int k = 0; k < LONGER; k++) {
            double total = ceil(near[i].total * longer[k] / period - 1e-9) * period;
            int place = many++;
            for (; place && tries[place - 1].total > total; place--)
                tries[place] = tries[place - 1];
            tries[place] = (try_t){total, near[i].pair, near[i].way};
        }
    return many;
}

/* Write the increments of the first connector that keeps the bounds, and return it; or none. */
static const try_t *first_kept(const search_t *search, const try_t *tries, int count,
                               vec_t w[FACTORS]) {
    for (int i = 0; i < count; i++) {
        double h = between_ramps(search, tries[i].total, tries[i].pair);
        quat_t middle = put_outer(search, tries[i].pair, h, w);
        w[2] = logarithm(tries[i].way ? opposite(middle) : middle);
        if (keeps(w, h, &search->points, &search->bounds))
            return &tries[i];
    }
    return NULL;
}

/* Write the increments of the shortest connector that is found, and return it; or none. */
static const try_t *shortest(search_t *search, int totals, vec_t w[FACTORS]) {
    int pairs = search->into.count * search->out_of.count, count = 0, looked = 0;
    for (int pair = 0; pair < pairs; pair++)
        search->pairs[pair] = pair;
    while (looked < totals && count < BEST)
        count = add_seen(search, search->pairs, pairs, search->totals[looked++], search->found,
                         count);
    if (!count)
        return NULL;
    /* Once more, between the shortest duration that will do and the one before it. */
    int nearest[BEST], count_again = 0;
    int nearest_pairs = put_pairs(search->found, (int)least(count, BEST), nearest);
    double step = totals > 1 ? search->totals[1] / search->totals[0] : 1.0, finer[REFINED];
    int finer_totals = put_refined(search->found[0].total, step, search, finer);
    for (int i = 0; i < finer_totals; i++)
        count_again = add_seen(search, nearest, nearest_pairs, finer[i], search->again,
                               count_again);
    try_t near[BEST];
    int many = merge(search->found, count, search->again, count_again, near, BEST);
    many = put_longer(near, many, search->period, search->tries);
    const try_t *kept = first_kept(search, search->tries, many, w);
    if (kept != NULL)
        return kept;
    /* None of these: then any. */
    while (looked < totals)
        count = add_seen(search, search->pairs, pairs, search->totals[looked++], search->found,
                         count);
    many = merge(search->found, count, search->again, count_again, search->tries,
                 SEEN + SEEN_AGAIN);
    return first_kept(search, search->tries, many, w);
}

/* A motion when time runs backwards. */
INLINE motion_t mirrored(motion_t state) {
    state.omega = times(-1.0, state.omega);
    return state;
}

/* The quaternion that a join arrives at, with the sign it has there. */
static quat_t arrival(quat_t q, const vec_t w[FACTORS]) {
    for (int k = 0; k < FACTORS; k++)
        q = multiplied(q, exponential(w[k]));
    return q;
}

/* Of the two quaternions of an orientation, the one nearer to another. */
INLINE quat_t nearer(quat_t q, quat_t other) {
    return q.w * other.w + q.x * other.x + q.y * other.y + q.z * other.z < 0.0 ? opposite(q) : q;
}

bool find_connector(row_t start, row_t end, matrix_t limits, double period, double least_duration,
                    double most_turn, matrix_t q, tensor_t w, row_t times_of) {
    motion_t begin = state_at(start.v), finish = state_at(end.v), back = mirrored(finish);
    search_t search;
    search.period = period, search.least = least_duration, search.most_turn = most_turn;
    search.bounds = bounds_of(&begin, &finish, limits);
    put_points(&search.points);
    quat_t turn = relative(begin.q, finish.q);
    vec_t way = times(2.0, logarithm(shorter(turn)));
    search.into = ramps_from(&begin, way, limits, &search.bounds, period, false);
    search.out_of = ramps_from(&back, times(-1.0, way), limits, &search.bounds, period, false);
    for (int i = 0; i < search.out_of.count; i++)
        search.out_of.ends[i] = mirrored(search.out_of.ends[i]);
    for (int i = 0; i < search.into.count; i++)
        search.into_turn[i] = turn_of_ramp(begin, search.into.ends[i], search.into.durations[i]);
    for (int i = 0; i < search.out_of.count; i++)
        search.out_of_turn[i] = turn_of_ramp(search.out_of.ends[i], finish,
                                             search.out_of.durations[i]);

    vec_t of[3][FACTORS] = {0};
    const try_t *kept = shortest(&search, put_grid(&begin, &finish, norm(way), &search), of[1]);
    if (kept == NULL)
        return false;
    int one = kept->pair / search.out_of.count, other = kept->pair % search.out_of.count;
    double before = search.into.durations[one], after = search.out_of.durations[other];
    motion_t from = search.into.ends[one], to = search.out_of.ends[other];
    times_of.v[0] = 0.0, times_of.v[1] = before;
    times_of.v[2] = kept->total - after, times_of.v[3] = kept->total;
    /* Each section begins with the quaternion sign at which the previous one ends. */
    if (before > 0.0) {
        put_increments(&begin, &from, before, of[0]);
        from.q = nearer(from.q, arrival(begin.q, of[0]));
    }
    if (after > 0.0)
        put_increments(&to, &finish, after, of[2]);
    to.q = nearer(to.q, arrival(from.q, of[1]));
    put_quat(row_of(q, 0), begin.q), put_quat(row_of(q, 1), from.q), put_quat(row_of(q, 2), to.q);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < FACTORS; k++)
            put_vec(w.v + (i * FACTORS + k) * 3, of[i][k]);
    return true;
}

/* With a share of the velocity and acceleration that it has. */
static motion_t with_share(motion_t state, double share) {
    state.omega = times(share, state.omega), state.alpha = times(share, state.alpha);
    return state;
}

void guess_connector(row_t start, row_t end, matrix_t limits, double period, double least_duration,
                     double rates, double duration, matrix_t q, tensor_t w, row_t times_of) {
    motion_t begin = state_at(start.v), finish = state_at(end.v);
    search_t search;
    search.period = period, search.least = least_duration;
    search.bounds = bounds_of(&begin, &finish, limits);
    quat_t turn = relative(begin.q, finish.q);
    double angle = 2.0 * norm(logarithm(shorter(turn)));
    double total = duration * search.totals[put_grid(&begin, &finish, angle, &search) / 2];
    begin = with_share(begin, rates), finish = with_share(finish, rates);
    vec_t of[3][FACTORS] = {0};
    quat_t middle = put_outer_increments(&begin, &finish, total, of[1]);
    of[1][2] = logarithm(middle);
    double turned = norm(turn_of_join(of[1]));
    of[1][2] = logarithm(opposite(middle));
    if (norm(turn_of_join(of[1])) > turned)
        of[1][2] = logarithm(middle);
    put_quat(row_of(q, 0), begin.q), put_quat(row_of(q, 1), begin.q);
    put_quat(row_of(q, 2), arrival(begin.q, of[1]));
    times_of.v[0] = times_of.v[1] = 0.0, times_of.v[2] = times_of.v[3] = total;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < FACTORS; k++)
            put_vec(w.v + (i * FACTORS + k) * 3, of[i][k]);
}
