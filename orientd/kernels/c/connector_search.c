/* One join from a state to another: the shortest that keeps the limits, or a guess to be shortened.
 *
 * A quintic that begins with a large acceleration keeps some of it for long, and may not keep the
 * limit of the velocity for any duration.  What is shortened from a guess need not be one join.
 */
#include "connectors.h"

enum {
    GRID = 16,          /* durations of the first look */
    REFINED = 12,       /* durations of the second look */
    PARTS_OF_TURN = 6,  /* of a join, in which its velocity is integrated */
};

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
static int put_grid(const motion_t *start, const motion_t *end, const bounds_t *bounds, double period,
                    double least, double totals[GRID]) {
    double angle = 2.0 * norm(logarithm(shorter(relative(start->q, end->q))));
    double velocity = least_of(bounds->most[0]), acceleration = least_of(bounds->most[1]);
    double jerk = least_of(bounds->most[2]);
    double change = norm(minus(end->omega, start->omega));
    double speeds = norm(start->omega) + norm(end->omega);
    double sizes = norm(start->alpha) + norm(end->alpha);
    double shortest = fmax(0.5 * angle / bounds->most[0][0], sqrt(angle / bounds->most[1][0]));
    shortest = fmax(fmax(shortest, change / bounds->most[1][0]), fmax(period, least));
    double longest = 2.0 * angle / velocity + 3.0 * sqrt(angle / acceleration)
                   + 5.0 * cbrt(angle / jerk) + 5.0 * speeds / acceleration
                   + 8.0 * sqrt(speeds / jerk) + 12.0 * sizes / jerk + 8.0 * period;
    longest = fmax(fmax(longest, 3.0 * least), shortest);
    double step = log(longest / shortest) / (GRID - 1);
    int count = 0;
    for (int k = 0; k < GRID; k++)
        count = add_total(shortest * exp(step * k), period, count, totals);
    return count;
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

/* Write the join of a duration that keeps the limits, the shorter way round if both do; return
 * whether one does. */
static bool find_way(const motion_t *start, const motion_t *end, const bounds_t *bounds,
                     double most_turn, double total, single_t *found) {
    quat_t middle = put_outer_increments(start, end, total, found->w);
    found->total = total;
    for (int way = 0; way < 2; way++) {
        found->w[2] = logarithm(way ? opposite(middle) : middle);
        if (keeps(found->w, total, bounds) && norm(turn_of_join(found->w)) <= most_turn)
            return true;
    }
    return false;
}

bool find_join(const motion_t *start, const motion_t *end, matrix_t limits, double period,
               double least_duration, double most_turn, single_t *found) {
    bounds_t bounds = bounds_of(start, end, limits);
    double totals[GRID], finer[REFINED];
    int count = put_grid(start, end, &bounds, period, least_duration, totals), place = 0, many = 0;
    while (place < count && !find_way(start, end, &bounds, most_turn, totals[place], found))
        place++;
    if (place == count)
        return false;
    /* Once more, between the shortest duration that will do and the one before it. */
    double step = totals[place] / totals[place ? place - 1 : 0];
    for (int k = REFINED - 1; k >= 0; k--)
        many = add_total(totals[place] * pow(step, -k / (double)REFINED), period, many, finer);
    for (int k = 0; k < many; k++)
        if (find_way(start, end, &bounds, most_turn, finer[k], found))
            return true;
    return find_way(start, end, &bounds, most_turn, totals[place], found);
}

/* With a share of the velocity and acceleration that it has. */
static motion_t with_share(const motion_t *state, double share) {
    return (motion_t){state->q, times(share, state->omega), times(share, state->alpha)};
}

single_t guess_join(const motion_t *start, const motion_t *end, matrix_t limits, double period,
                    double least_duration, double rates, double duration) {
    bounds_t bounds = bounds_of(start, end, limits);
    motion_t begin = with_share(start, rates), finish = with_share(end, rates);
    double totals[GRID];
    single_t guess;
    int count = put_grid(start, end, &bounds, period, least_duration, totals);
    double falls = (norm(start->alpha) + norm(end->alpha)) / least_of(bounds.most[2]);
    guess.total = larger(duration * totals[count / 2], larger(1.25 * falls, 3.0 * period));
    quat_t middle = put_outer_increments(&begin, &finish, guess.total, guess.w);
    guess.w[2] = logarithm(middle);
    double turned = norm(turn_of_join(guess.w));
    guess.w[2] = logarithm(opposite(middle));
    if (norm(turn_of_join(guess.w)) > turned)
        guess.w[2] = logarithm(middle);
    return guess;
}
