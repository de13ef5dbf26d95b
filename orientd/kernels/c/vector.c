/* The law for a vector; see vector.h. */
#include "vector.h"

#include <string.h>

/* Angle of a step that is rest, rad. */
#define STILL 1e-14
/* Most cycles of a stop. */
enum { LONGEST_STOP = 4000 };

static gauges_t gauges_of(row_t limits, double period) {
    gauges_t g = {.n = 3, .period = period};
    double *unit[3] = {&g.turn[0].x, &g.turn[1].y, &g.turn[2].z};
    for (int k = 0; k < 3; k++)
        *unit[k] = 1.0;
    for (int rate = VELOCITY; rate < RATES; rate++) {
        g.turning[rate] = 1.0 / limits.v[rate];
        for (int k = 0; k < 3; k++)
            g.components[rate][k] = 1.0 / limits.v[RATES + 3 * rate + k];
    }
    return g;
}

bool pursue_vector(row_t limits, double period, row_t state, row_t reference, row_t following,
                   row_t taken, row_t acceleration) {
    gauges_t g = gauges_of(limits, period);
    const double *e = state.v + WAY, *v = state.v + SPEED, *a = state.v + CHANGE;
    const double *vr = reference.v, *ar = vr + 3, *next = ar + 3;
    double wanted[MOST_COORDINATES] = {0}, twist[MOST_COORDINATES] = {0};
    manner_t manner;
    calm_t calm;
    memcpy(&manner, following.v, sizeof manner);
    memcpy(&calm, following.v + sizeof manner / sizeof(double), sizeof calm);
    double slack = following.v[VECTOR_FOLLOWING - 1];
    for (int k = 0; k < 3; k++)
        twist[k] = next[k] - ar[k];
    taken.v[VELOCITY] = gauge(&g, VELOCITY, vr), taken.v[ACCELERATION] = gauge(&g, ACCELERATION, ar);
    taken.v[JERK] = gauge(&g, JERK, twist) / period;
    bool is_linear = pursue(&g, &manner, &calm, e, v, a, vr, ar, wanted);
    double size = norm(vec_at(wanted)), share = 1.0;
    if (is_linear && calm.margin < INFINITY && size > calm.most)
        share = calm.most / size;
    for (int k = 0; is_linear && k < 3; k++)
        wanted[k] = share * wanted[k] + twist[k];
    if (slack < INFINITY)
        keep_distance(&g, slack, e, v, a, vr, ar, wanted);
    advance(&g, v, a, wanted, loosened(&g, v, a), acceleration.v);
    return is_linear;
}

void halt_vector(row_t limits, double period, row_t state, row_t aside, row_t acceleration) {
    gauges_t g = gauges_of(limits, period);
    halt(&g, state.v + SPEED, state.v + CHANGE, aside.v, acceleration.v);
}

/* The angle from a cone's direction to the tool's axis. */
static double angle_to(const double *cone, quat_t q) {
    vec_t axis = turned(q, vec_at(cone)), direction = vec_at(cone + 3);
    return atan2(norm(cross(axis, direction)), dot(axis, direction));
}

double stop_clearance(row_t limits, double period, row_t state, matrix_t cones) {
    gauges_t g = gauges_of(limits, period);
    double v[MOST_COORDINATES] = {0}, a[MOST_COORDINATES] = {0}, next[MOST_COORDINATES] = {0};
    double least = INFINITY;
    memcpy(v, state.v + SPEED, 3 * sizeof(double)), memcpy(a, state.v + CHANGE, 3 * sizeof(double));
    quat_t q = quat(1.0, 0.0, 0.0, 0.0);
    for (int k = 0; k < LONGEST_STOP; k++) {
        quat_t before = q;
        q = multiplied(q, exponential(times(0.5 * period, vec_at(v))));
        for (index_t i = 0; i < cones.n; i++) {
            const double *cone = row_of(cones, i);
            double angle = angle_to(cone, q), bound = cone[6];
            if (angle < bound)
                bound = smaller(bound, angle_to(cone, before));
            least = smaller(least, angle - bound);
        }
        if (norm(vec_at(v)) * period < STILL && norm(vec_at(a)) * period * period < STILL)
            break;
        halt(&g, v, a, NULL, next);
        for (int c = 0; c < 3; c++)
            a[c] = next[c], v[c] += period * next[c];
    }
    return least;
}
