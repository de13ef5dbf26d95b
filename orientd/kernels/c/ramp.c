/* Ramps: changes of the acceleration alone, at the limit of the jerk. */
#include "connectors.h"

/* Sizes that count as none, rad/s and rad/s^2. */
#define STILL 1e-9

enum { SUBSTEPS = 2 };  /* of Magnus' expansion, in a ramp */

/* Where a ramp leads to, by Magnus' expansion of fourth order:
 *
 *     exp(h/2 (omega_a + omega_b) + sqrt(3)/12 h^2 omega_a x omega_b)
 *
 * Blanes et al. (2009), eq. 254, for q' = 1/2 q omega, whose sign of the commutator is the opposite
 * one, with the velocities at Gauss' two nodes. */
static quat_t after_ramp(const motion_t *state, vec_t goal, double duration) {
    double h = duration / SUBSTEPS, rate = duration > 0.0 ? 1.0 / duration : 1.0;
    double node = sqrt(3.0) / 6.0, share = sqrt(3.0) / 24.0 * h * h;
    vec_t slope = minus(goal, state->alpha);
    quat_t here = state->q;
    for (int step = 0; step < SUBSTEPS; step++) {
        double t[2] = {(step + 0.5 - node) * h, (step + 0.5 + node) * h};
        vec_t at[2];
        for (int i = 0; i < 2; i++)
            at[i] = plus(plus(state->omega, times(t[i], state->alpha)),
                         times(0.5 * t[i] * t[i] * rate, slope));
        vec_t half = plus(times(0.25 * h, plus(at[0], at[1])),
                          times(share, cross(at[0], at[1])));
        here = multiplied(here, exponential(half));
    }
    return here;
}

/* How long a change of the acceleration takes with all of the jerk, s. */
static double duration_of(vec_t change, const double jerk[4]) {
    return fmax(fmax(norm(change) / jerk[0], fabs(change.x) / jerk[1]),
                fmax(fabs(change.y) / jerk[2], fabs(change.z) / jerk[3]));
}

/* The angular velocity at the end of a ramp. */
static vec_t speed_after(const motion_t *state, vec_t goal, double duration) {
    return plus(state->omega, times(0.5 * duration, plus(state->alpha, goal)));
}

/* Add the ramp to an acceleration, unless it becomes too fast: in cycles, the whole ones that there
 * are of it where it would be with the last one, and right up to the limit. */
static void add_ramp(ramps_t *ramps, const motion_t *state, vec_t goal, matrix_t limits,
                     const bounds_t *bounds, double period, bool in_cycles) {
    double duration = 0.0;
    vec_t speed = state->omega;
    if (ramps->count) {
        double most[4];
        for (int k = 0; k < 4; k++)
            most[k] = fmax(bounds->most[0][k], in_cycles ? row_of(limits, 0)[k] : 0.0);
        vec_t change = minus(goal, state->alpha);
        double least = fmax(duration_of(change, row_of(limits, 2)), period);
        duration = in_cycles ? ceil(least / period - 1e-9) * period : least;
        speed = speed_after(state, goal, duration);
        if (in_cycles && exceeds(speed, most) && duration > period) {
            duration -= period;
            goal = plus(state->alpha, times(duration / least, change));
            speed = speed_after(state, goal, duration);
        }
        if (exceeds(speed, most))
            return;
    }
    ramps->ends[ramps->count] = (motion_t){after_ramp(state, goal, duration), speed, goal};
    ramps->durations[ramps->count++] = duration;
}

/* A limit on the component along a direction. */
static double limit_along(vec_t direction, const double limits[4]) {
    double limit = limits[0], parts[3] = {direction.x, direction.y, direction.z};
    for (int k = 0; k < 3; k++)
        if (fabs(parts[k]) * limit > limits[k + 1])
            limit = limits[k + 1] / fabs(parts[k]);
    return limit;
}

ramps_t ramps_from(const motion_t *state, vec_t way, matrix_t limits, const bounds_t *bounds,
                   double period, bool in_cycles) {
    ramps_t ramps;
    ramps.count = 0;
    add_ramp(&ramps, state, state->alpha, limits, bounds, period, in_cycles);
    if (norm(state->alpha) > STILL)
        add_ramp(&ramps, state, vec(0.0, 0.0, 0.0), limits, bounds, period, in_cycles);
    vec_t towards[2] = {times(-1.0, state->omega), way};
    for (int i = 0; i < 2; i++) {
        double size = norm(towards[i]);
        if (!(size > STILL))
            continue;
        vec_t direction = times(1.0 / size, towards[i]);
        double limit = limit_along(direction, row_of(limits, 1));
        if (!(limit < INFINITY))
            continue;
        for (int half = 1; half <= 2; half++)
            add_ramp(&ramps, state, times(0.5 * half * limit, direction), limits, bounds, period,
                     in_cycles);
    }
    return ramps;
}
