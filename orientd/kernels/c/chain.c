/* A serial chain within its limits; see chain.h. */
#include "chain.h"

#include <string.h>

/* Rounding allows as much more than a limit, as a share of it. */
#define ROUNDING (1.0 + 1e-6)
#define ANGLE_ROUNDING 1e-12
/* Rounding of a step of the tool, rad or m; it is divided by powers of the period. */
#define STEP_ROUNDING 4e-15
/* Share of the tool's velocities to aim at: a step's norm is not quite that of the rates. */
#define SPEED_SHARE 0.99
/* Least share of the tool's acceleration that is left for changes of the joints' rates. */
#define LEAST_SHARE 0.2
/* Largest acceleration of an axis that knows no limit, rad/s^2. */
#define UNLIMITED 1e9
/* Step of a joint that is rest, rad. */
#define STILL 1e-14
/* Cosine by which an axis may come nearer to a cone inside of it, by rounding. */
#define COSINE_ROUNDING 1e-14
/* Most cycles of a stop of axes that brake each by itself. */
enum { LONGEST_BRAKING = 4000 };

typedef struct { quat_t q; vec_t p; } place_t;
typedef struct { vec_t turn[MOST_COORDINATES], move[MOST_COORDINATES]; } jacobian_t;

static place_t rest_of(row_t chain) { return (place_t){quat_at(chain.v), vec_at(chain.v + 4)}; }
static const double *axis_of(row_t chain, index_t i) {
    return chain.v + CHAIN_POSE + CHAIN_AXIS * i;
}
static index_t axes_in(row_t chain) { return (chain.n - CHAIN_POSE) / CHAIN_AXIS; }

/* The tool's pose; its jacobian too, if it is asked for. */
static place_t place_tool(row_t chain, const double *joints, jacobian_t *jacobian) {
    index_t n = axes_in(chain);
    place_t at = {quat(1.0, 0.0, 0.0, 0.0), vec(0.0, 0.0, 0.0)}, first = rest_of(chain);
    vec_t points[MOST_COORDINATES];
    for (index_t i = 0; i < n; i++) {
        vec_t axis = vec_at(axis_of(chain, i)), point = vec_at(axis_of(chain, i) + 3);
        vec_t on = plus(at.p, turned(at.q, point));
        if (jacobian != NULL)
            jacobian->turn[i] = turned(at.q, axis), points[i] = on;
        at.q = multiplied(at.q, exponential(times(0.5 * joints[i], axis)));
        at.p = minus(on, turned(at.q, point));
    }
    at.p = plus(at.p, turned(at.q, first.p));
    at.q = multiplied(at.q, first.q);
    for (index_t i = 0; jacobian != NULL && i < n; i++) {
        jacobian->move[i] = cross(jacobian->turn[i], minus(at.p, points[i]));
        jacobian->turn[i] = turned(conjugated(at.q), jacobian->turn[i]);
    }
    return at;
}

static vec_t mapped(index_t n, const vec_t *columns, const double *u) {
    vec_t total = vec(0.0, 0.0, 0.0);
    for (index_t i = 0; i < n; i++)
        total = scaled_plus(u[i], columns[i], total);
    return total;
}

static double reciprocal(double limit) { return limit > 0.0 ? 1.0 / limit : INFINITY; }

/* The rest of a limit, without the part that constant rates take of it, but never nothing. */
static double left_of(double limit, double taken, double share) {
    return reciprocal(larger(share * (limit - taken), LEAST_SHARE * limit));
}

/* The gauges at some joints, for a share of the tool's limits. */
static gauges_t gauges_at(const limited_chain_t *arm, const double *joints, const double *rates,
                          double share) {
    index_t n = arm->axes.n;
    double h = arm->period, next[MOST_COORDINATES] = {0};
    gauges_t g = {.n = n, .period = h};
    for (index_t i = 0; i < n; i++) {
        const double *limits = row_of(arm->axes, i) + AXIS_RATES;
        double acceleration = smaller(limits[ACCELERATION], UNLIMITED);
        g.own[VELOCITY][i] = 1.0 / limits[VELOCITY];
        g.own[ACCELERATION][i] = 1.0 / acceleration;
        /* More jerk saves no time, and makes a stop in whole cycles less exact. */
        g.own[JERK][i] = 1.0 / smaller(limits[JERK], 0.5 * acceleration / h);
        next[i] = joints[i] + h * rates[i];
    }
    jacobian_t here, there;
    place_tool(arm->chain, joints, &here), place_tool(arm->chain, next, &there);
    memcpy(g.turn, here.turn, sizeof g.turn), memcpy(g.move, here.move, sizeof g.move);
    vec_t turn = minus(mapped(n, there.turn, rates), mapped(n, here.turn, rates));
    vec_t move = minus(mapped(n, there.move, rates), mapped(n, here.move, rates));
    const double *norms = arm->tool.v, *parts = norms + TOOL_COMPONENTS;
    const double *linear = norms + TOOL_LINEAR, bends[3] = {turn.x, turn.y, turn.z};
    g.turning[VELOCITY] = reciprocal(SPEED_SHARE * norms[VELOCITY]);
    g.turning[ACCELERATION] = left_of(norms[ACCELERATION], norm(turn) / h, share);
    g.turning[JERK] = reciprocal(share * norms[JERK]);
    for (int k = 0; k < 3; k++) {
        g.components[VELOCITY][k] = reciprocal(SPEED_SHARE * parts[k]);
        g.components[ACCELERATION][k] = left_of(parts[3 + k], fabs(bends[k]) / h, share);
        g.components[JERK][k] = reciprocal(share * parts[6 + k]);
    }
    g.moving[VELOCITY] = reciprocal(SPEED_SHARE * linear[VELOCITY]);
    g.moving[ACCELERATION] = left_of(linear[ACCELERATION], norm(move) / h, share);
    return g;
}

static void scale(index_t n, double s, double *u) {
    for (index_t i = 0; i < n; i++)
        u[i] *= s;
}

/* Place and motion of a reference, in coordinates of the joints. */
typedef struct {
    double way[MOST_COORDINATES], rates[MOST_COORDINATES], bend[MOST_COORDINATES];
    double next_bend[MOST_COORDINATES];
} course_t;

/* The way to a reference inside the ranges, and its differences; the goal receives its end. */
static course_t course_to(const limited_chain_t *arm, const double *x, matrix_t reference,
                          double *goal) {
    double h = arm->period;
    course_t to = {0};
    for (index_t i = 0; i < arm->axes.n; i++) {
        const double *limits = row_of(arm->axes, i);
        double now = row_of(reference, NOW)[i];
        goal[i] = larger(now, smaller(limits[AXIS_LOW], x[i]));
        goal[i] = smaller(goal[i], larger(limits[AXIS_HIGH], x[i]));
        to.way[i] = goal[i] - x[i];
        if (goal[i] != now || reference.n < REFERENCE_ROWS)
            continue;
        double before = row_of(reference, BEFORE)[i], earlier = row_of(reference, EARLIER)[i];
        to.rates[i] = (now - before) / h;
        to.bend[i] = (now - 2.0 * before + earlier) / h / h;
        to.next_bend[i] = (row_of(reference, LATER)[i] - 2.0 * now + before) / h / h;
    }
    return to;
}

void pursue_joints(const limited_chain_t *arm, matrix_t joints, matrix_t reference, bool is_way,
                   row_t following, row_t taken, row_t goal, row_t accelerations) {
    index_t n = arm->axes.n;
    const double *x = row_of(joints, JOINTS_AT), *v = row_of(joints, JOINT_RATES);
    const double *a = row_of(joints, JOINT_CHANGES);
    double twist[MOST_COORDINATES] = {0}, wanted[MOST_COORDINATES] = {0};
    course_t to = {0};
    if (is_way)
        memcpy(to.way, reference.v, (size_t)n * sizeof(double));
    else
        to = course_to(arm, x, reference, goal.v);
    gauges_t g = gauges_at(arm, x, v, following.v[0]);
    manner_t manner;
    memcpy(&manner, following.v + 1, sizeof manner);
    /* The axes get no feed-forward that they cannot follow. */
    double fast = gauge(&g, VELOCITY, to.rates), bends = fast > 1.0 ? 0.0 : 1.0;
    double hard = gauge(&g, ACCELERATION, to.bend);
    double later = gauge(&g, ACCELERATION, to.next_bend);
    scale(n, 1.0 / larger(fast, 1.0), to.rates);
    scale(n, bends / larger(hard, 1.0), to.bend);
    scale(n, bends / larger(later, 1.0), to.next_bend);
    for (index_t i = 0; i < n; i++)
        twist[i] = to.next_bend[i] - to.bend[i];
    taken.v[VELOCITY] = fast, taken.v[ACCELERATION] = hard;
    taken.v[JERK] = gauge(&g, JERK, twist) / arm->period;
    bool is_linear = pursue(&g, &manner, NULL, to.way, v, a, to.rates, to.bend, wanted);
    for (index_t i = 0; is_linear && i < n; i++)
        wanted[i] += twist[i];
    advance(&g, v, a, wanted, loosened(&g, v, a), accelerations.v);
}

static bool strained(row_t strain, int kind, index_t place, double value, double limit) {
    strain.v[0] = kind, strain.v[1] = (double)place, strain.v[2] = value, strain.v[3] = limit;
    return true;
}

/* Whether a step of the joints breaks a limit of an axis. */
static bool strains_axes(const limited_chain_t *arm, const double *x, const double *v,
                         const double *a, const double *before, row_t strain) {
    double h = arm->period, slack = ANGLE_ROUNDING / h;
    for (index_t i = 0; i < arm->axes.n; i++) {
        const double *limits = row_of(arm->axes, i), *most = limits + AXIS_RATES;
        double sizes[RATES] = {fabs(v[i]), fabs(a[i]), fabs(a[i] - before[i]) / h};
        double slacks[RATES] = {slack, slack / h, slack / h / h};
        for (int rate = VELOCITY; rate < RATES; rate++)
            if (!(sizes[rate] <= most[rate] * ROUNDING + slacks[rate]))
                return strained(strain, AXIS_RATE + rate, i, sizes[rate], most[rate]);
        bool is_high = x[i] > limits[AXIS_HIGH] + ANGLE_ROUNDING && v[i] > 0.0;
        if (is_high || (x[i] < limits[AXIS_LOW] - ANGLE_ROUNDING && v[i] < 0.0))
            return strained(strain, RANGE, i, x[i], limits[is_high ? AXIS_HIGH : AXIS_LOW]);
    }
    return false;
}

/* The tool at a setpoint, and its differences up to there. */
typedef struct { place_t at; vec_t omega, alpha, velocity; } tool_t;

/* Whether a step of the tool breaks one of its limits; the tool moves to the end of the step. */
static bool strains_tool(const limited_chain_t *arm, tool_t *tool, place_t at, row_t strain) {
    double h = arm->period;
    vec_t omega = times(2.0 / h, logarithm(shorter(relative(tool->at.q, at.q))));
    vec_t alpha = times(1.0 / h, minus(omega, tool->omega));
    vec_t jerk = times(1.0 / h, minus(alpha, tool->alpha));
    vec_t velocity = times(1.0 / h, minus(at.p, tool->at.p));
    vec_t acceleration = times(1.0 / h, minus(velocity, tool->velocity));
    *tool = (tool_t){at, omega, alpha, velocity};
    const double *limits = arm->tool.v, *parts = limits + TOOL_COMPONENTS;
    vec_t turns[RATES] = {omega, alpha, jerk}, moves[2] = {velocity, acceleration};
    double slack = STEP_ROUNDING / h;
    for (int rate = VELOCITY; rate < RATES; rate++, slack /= h, parts += 3) {
        vec_t u = turns[rate];
        if (!(norm(u) <= limits[rate] * ROUNDING + slack))
            return strained(strain, TOOL_RATE + rate, -1, norm(u), limits[rate]);
        double sizes[3] = {fabs(u.x), fabs(u.y), fabs(u.z)};
        for (int k = 0; k < 3; k++)
            if (!(sizes[k] <= parts[k] * ROUNDING + slack))
                return strained(strain, TOOL_RATE + rate, k, sizes[k], parts[k]);
        if (rate == JERK)
            break;
        double size = norm(moves[rate]), most = limits[TOOL_LINEAR + rate];
        if (!(size <= most * ROUNDING + slack))
            return strained(strain, LINEAR_RATE + rate, -1, size, most);
    }
    return false;
}

/* The first cone into which a step of the tool leads, or their number.  Inside of one it may turn
 * outwards.  The direction of every cone may have turned by an angle. */
static index_t entered(matrix_t cones, quat_t before, quat_t q, double turn) {
    for (index_t i = 0; i < cones.n; i++) {
        const double *cone = row_of(cones, i);
        vec_t axis = vec_at(cone), direction = vec_at(cone + 3), at = turned(q, axis);
        double angle = cone[CONE - 1] + turn;
        if (!(angle > 0.0 && dot(at, direction) > cos(smaller(angle, M_PI))))
            continue;
        vec_t step = minus(at, turned(before, axis));
        if (dot(step, direction) + turn * norm(step) > COSINE_ROUNDING)
            return i;
    }
    return cones.n;
}

index_t roll_stop(const limited_chain_t *arm, matrix_t joints, row_t differences, matrix_t cones,
                  double share, double drift, row_t accelerations, matrix_t stop, row_t strain) {
    index_t n = arm->axes.n;
    double h = arm->period, x[MOST_COORDINATES] = {0}, v[MOST_COORDINATES] = {0};
    double a[MOST_COORDINATES] = {0}, next[MOST_COORDINATES] = {0};
    size_t size = (size_t)n * sizeof(double);
    memcpy(x, row_of(joints, JOINTS_AT), size), memcpy(v, row_of(joints, JOINT_RATES), size);
    memcpy(a, row_of(joints, JOINT_CHANGES), size);
    const double *given = differences.v;
    tool_t tool = {place_tool(arm->chain, x, NULL), vec_at(given), vec_at(given + 3),
                   vec_at(given + 6)};
    gauges_t g = gauges_at(arm, x, v, share);
    bool is_stop = isnan(accelerations.v[0]);
    for (index_t k = 0; k < stop.n; k++) {
        if (k || is_stop)
            halt(&g, v, a, NULL, next);
        else
            memcpy(next, accelerations.v, size);
        double largest = 0.0;
        for (index_t i = 0; i < n; i++) {
            double change = next[i];
            next[i] = a[i], a[i] = change, v[i] += h * change, x[i] += h * v[i];
            largest = larger(largest, h * (fabs(v[i]) + h * fabs(a[i])));
        }
        if (strains_axes(arm, x, v, a, next, strain))
            return 0;
        quat_t before = tool.at.q;
        if (strains_tool(arm, &tool, place_tool(arm->chain, x, NULL), strain))
            return 0;
        index_t cone = entered(cones, before, tool.at.q, drift * h * (double)k);
        if (cone < cones.n) {
            strained(strain, IN_CONE, cone, 0.0, 0.0);
            return 0;
        }
        memcpy(row_of(stop, k), x, size);
        if (largest < STILL)
            return k + 1;
    }
    strained(strain, TOO_LONG, -1, (double)stop.n, (double)stop.n);
    return 0;
}

bool brakes_outside(row_t chain, matrix_t axes, matrix_t joints, double period, matrix_t cones) {
    double x[MOST_COORDINATES] = {0}, v[MOST_COORDINATES] = {0};
    size_t size = (size_t)axes.n * sizeof(double);
    memcpy(x, row_of(joints, JOINTS_AT), size), memcpy(v, row_of(joints, JOINT_RATES), size);
    quat_t before = place_tool(chain, x, NULL).q;
    for (int k = 0; k < LONGEST_BRAKING; k++) {
        bool moves = false;
        for (index_t i = 0; i < axes.n; i++) {
            double step = k ? row_of(axes, i)[AXIS_RATES + ACCELERATION] * period : 0.0;
            v[i] -= larger(-step, smaller(v[i], step));
            x[i] += period * v[i];
            moves |= v[i] != 0.0;
        }
        quat_t q = place_tool(chain, x, NULL).q;
        if (entered(cones, before, q, 0.0) < cones.n)
            return false;
        if (!moves)
            return true;
        before = q;
    }
    return false;
}
