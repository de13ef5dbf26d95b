/* The way from a motion to rest: one join, after a ramp if that is quicker.
 *
 * The join goes from (q, omega, alpha) to q exp(omega T/2 + alpha T^2/12).  For parallel vectors
 * its velocity is then the cubic
 *
 *     Omega(u) = omega (1 - 3 u^2 + 2 u^3) + alpha T (u - 2 u^2 + u^3),   u = t / T,
 *
 * which falls to rest with no acceleration left.  Without velocity it returns to q itself, with
 * Omega(u) = alpha T / 2 (2 u - 9 u^2 + 12 u^3 - 5 u^4).  The closed form finds a duration to begin
 * with; the join itself is then held against the limits.
 */
#include "connectors.h"

#define STILL 1e-9         /* rad/s, below which nothing turns */
#define MARGIN 0.9999      /* of the velocity, for peaks between the points that are looked at */
#define ROUNDING 1e-9

enum { GRID = 160, COARSE = 33, FINEST = 65, NEAR = 5 };

/* Vectors that are not parallel need a little longer than the closed form says. */
static const double near_shares[NEAR] = {0.0, 0.005, 0.01, 0.02, 0.04};

/* The limits, but never less than what the device has at the beginning. */
static bounds_t bounds_at(const motion_t *state, matrix_t limits) {
    bounds_t bounds;
    for (int k = 0; k < 4; k++) {
        double speed = size_of(state->omega, k), size = size_of(state->alpha, k);
        bounds.most[0][k] = fmax(MARGIN * row_of(limits, 0)[k], (1.0 + ROUNDING) * speed);
        bounds.most[1][k] = fmax(row_of(limits, 1)[k], (1.0 + ROUNDING) * size);
        bounds.most[2][k] = row_of(limits, 2)[k];
    }
    return bounds;
}

static double least_of(const double most[4]) {
    return fmin(fmin(most[0], most[1]), fmin(most[2], most[3]));
}

static bool parallel_keeps(const motion_t *state, double duration, const bounds_t *bounds) {
    vec_t omega = state->omega, change = times(duration, state->alpha);
    bool moves = norm(omega) > STILL;
    double rate = 1.0 / duration;
    for (int k = 0; k < COARSE; k++) {
        double u = k / (COARSE - 1.0), uu = u * u, uuu = uu * u;
        double w[3] = {0.0, 0.0, 0.0}, a[3];
        if (moves) {
            w[0] = 1.0 - 3.0 * uu + 2.0 * uuu, w[1] = 6.0 * uu - 6.0 * u, w[2] = 12.0 * u - 6.0;
            a[0] = u - 2.0 * uu + uuu, a[1] = 1.0 - 4.0 * u + 3.0 * uu, a[2] = 6.0 * u - 4.0;
        } else {
            a[0] = 0.5 * (2.0 * u - 9.0 * uu + 12.0 * uuu - 5.0 * uu * uu);
            a[1] = 0.5 * (2.0 - 18.0 * u + 36.0 * uu - 20.0 * uuu);
            a[2] = 0.5 * (72.0 * u - 18.0 - 60.0 * uu);
        }
        double scale = 1.0;
        for (int order = 0; order < 3; order++, scale *= rate) {
            vec_t v = times(scale, plus(times(w[order], omega), times(a[order], change)));
            if (exceeds(v, bounds->most[order]))
                return false;
        }
    }
    return true;
}

/* Write the increments of the join; the way round may be more than half a turn. */
static void put_fall(const motion_t *state, double duration, vec_t w[FACTORS]) {
    double tenth = duration / 10.0, bend = duration * duration / 40.0;
    w[0] = times(tenth, state->omega);
    w[1] = plus(w[0], times(bend, state->alpha));
    w[3] = w[4] = vec(0.0, 0.0, 0.0);
    vec_t half = norm(state->omega) > STILL
        ? plus(times(0.25 * duration, state->omega),
               times(duration * duration / 24.0, state->alpha))
        : w[3];
    quat_t back = multiplied(exponential(times(-1.0, w[1])), exponential(times(-1.0, w[0])));
    w[2] = logarithm(multiplied(back, exponential(half)));
}

static bool fall_keeps(const vec_t w[FACTORS], double duration, const bounds_t *bounds) {
    join_t join = join_of(w, duration);
    double per_point = (FINEST - 1) / duration;
    vec_t before = vec(0.0, 0.0, 0.0);
    for (int k = 0; k < FINEST; k++) {
        basis_t at = join_basis(k / (FINEST - 1.0));
        motion_t here = join_at(quat(1.0, 0.0, 0.0, 0.0), &join, at);
        if (exceeds(here.omega, bounds->most[0]) || exceeds(here.alpha, bounds->most[1]))
            return false;
        if (k && exceeds(times(per_point, minus(here.alpha, before)), bounds->most[2]))
            return false;
        before = here.alpha;
    }
    return true;
}

/* Write the increments of the shortest fall that is found and return its duration; 0 if there is
 * none.  guess receives about how long it takes. */
static double shortest_fall(const motion_t *state, matrix_t limits, double period, double longest,
                            double *guess, vec_t w[FACTORS]) {
    bounds_t bounds = bounds_at(state, limits);
    double speed = norm(state->omega), size = norm(state->alpha);
    double jerk = least_of(bounds.most[2]);
    *guess = 1.5 * speed / least_of(bounds.most[1]) + sqrt(6.0 * speed / jerk) + 9.0 * size / jerk;
    if (!(*guess <= longest))
        return 0.0;
    double most = ceil(fmin(10.0 * *guess, longest) / period) + 8.0;
    double grid[GRID], low = 0.0, found = 0.0;
    int place = 0;
    for (int k = 0; k < GRID; k++)
        grid[k] = rint(exp(log(most) * k / (GRID - 1)));
    while (place < GRID && !parallel_keeps(state, period * grid[place], &bounds))
        low = grid[place++];
    if (place == GRID)
        return 0.0;
    for (found = grid[place]; found - low > 1.0;) {
        double middle = floor(0.5 * (low + found));
        if (!(middle > low && middle < found))  /* no double lies between them */
            break;
        if (parallel_keeps(state, period * middle, &bounds))
            found = middle;
        else
            low = middle;
    }
    double last = 0.0;
    for (int near = 0; near < NEAR || place < GRID;) {
        double close = near < NEAR ? found + ceil(found * near_shares[near]) : INFINITY;
        bool is_close = place == GRID || close <= grid[place];
        double cycles = is_close ? close : grid[place];
        if (is_close)
            near++;
        else
            place++;
        if (cycles == last || (!is_close && !parallel_keeps(state, period * cycles, &bounds)))
            continue;
        last = cycles;
        put_fall(state, cycles * period, w);
        if (fall_keeps(w, cycles * period, &bounds))
            return cycles * period;
    }
    return 0.0;
}

index_t leave(row_t state, matrix_t limits, double period, double longest, bool may_ramp,
              matrix_t q, tensor_t w, row_t breaks) {
    motion_t begin = state_at(state.v);
    bounds_t bounds = bounds_of(&begin, &begin, limits);
    ramps_t ramps = {{begin}, {0.0}, 1};
    if (may_ramp)
        ramps = ramps_from(&begin, vec(0.0, 0.0, 0.0), limits, &bounds, period, true);
    int best = -1;
    double least = INFINITY, guess = 0.0;
    vec_t of[2][FACTORS], fall[FACTORS];
    for (int i = 0; i < ramps.count; i++) {
        double took = shortest_fall(&ramps.ends[i], limits, period, longest, &guess, fall);
        if (!(took > 0.0 && ramps.durations[i] + took < least))
            continue;
        best = i, least = ramps.durations[i] + took;
        for (int k = 0; k < FACTORS; k++)
            of[1][k] = fall[k];
    }
    breaks.v[0] = 0.0, breaks.v[1] = guess;
    if (best < 0)
        return 0;
    double ramp = ramps.durations[best];
    int count = ramp > 0.0 ? 2 : 1;
    if (ramp > 0.0)
        put_increments(&begin, &ramps.ends[best], ramp, of[0]);
    put_quat(row_of(q, 0), begin.q), put_quat(row_of(q, count - 1), ramps.ends[best].q);
    breaks.v[1] = ramp, breaks.v[count] = least;
    for (int i = 0; i < count; i++)
        for (int k = 0; k < FACTORS; k++)
            put_vec(w.v + (i * FACTORS + k) * 3, of[i + 2 - count][k]);
    return count;
}
