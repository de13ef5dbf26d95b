/* One step a cycle inside convex limits; see law.h. */
#include "law.h"

#include <string.h>

#include "double_s.h"

/* Size below which a direction means nothing. */
#define NOTHING 1e-150
/* Share of the closing speed that is given up while all the motion is sideways. */
#define SPIRAL 0.6
/* Share of a limit that the linear law may use for a surprise. */
#define CALM 0.5
/* Share of a stop by which it may end beyond the end of the reference's own. */
#define LOOSE 0.1
/* Step in which a motion means nothing, rad or m. */
#define STANDING 1e-9
enum { TURNING_POINT_ROUNDS = 2, BISECTIONS = 10, SECANTS = 5 };

typedef double coordinates_t[MOST_COORDINATES];

static void sum(index_t n, const double *a, double s, const double *b, double *found) {
    for (index_t i = 0; i < n; i++)
        found[i] = a[i] + s * b[i];
}

static double inner(index_t n, const double *a, const double *b) {
    double total = 0.0;
    for (index_t i = 0; i < n; i++)
        total += a[i] * b[i];
    return total;
}

double gauge(const gauges_t *g, int rate, const double *u) {
    double size = 0.0;
    vec_t turn = vec(0.0, 0.0, 0.0), move = vec(0.0, 0.0, 0.0);
    for (index_t i = 0; i < g->n; i++) {
        size = larger(size, fabs(u[i]) * g->own[rate][i]);
        turn = scaled_plus(u[i], g->turn[i], turn);
        move = scaled_plus(u[i], g->move[i], move);
    }
    const double *parts = g->components[rate];
    size = larger(size, larger(norm(turn) * g->turning[rate], norm(move) * g->moving[rate]));
    return larger(larger(size, fabs(turn.x) * parts[0]),
                  larger(fabs(turn.y) * parts[1], fabs(turn.z) * parts[2]));
}

/* The velocity once the acceleration has fallen to zero along its line, one cycle's jerk a cycle. */
static void run_out(const gauges_t *g, const double *v, const double *a, double *found) {
    double cycles = gauge(g, JERK, a) / g->period, whole = floor(cycles);
    double share = cycles > 1.0 ? whole * (cycles - 0.5 * (whole + 1.0)) / cycles : 0.0;
    sum(g->n, v, g->period * share, a, found);
}

double loosened(const gauges_t *g, const double *v, const double *a) {
    coordinates_t later = {0};
    run_out(g, v, a, later);
    return larger(1.0, larger(gauge(g, VELOCITY, v), gauge(g, VELOCITY, later)));
}

/* Move an acceleration towards a wanted one by at most a cycle's jerk, and inside its limit. */
static void saturate(const gauges_t *g, const double *a, const double *wanted, double *found) {
    coordinates_t change = {0};
    double s = 1.0 / larger(gauge(g, ACCELERATION, wanted), 1.0);
    for (index_t i = 0; i < g->n; i++)
        change[i] = s * wanted[i] - a[i];
    s = 1.0 / larger(gauge(g, JERK, change) / g->period, 1.0);
    sum(g->n, a, s, change, found);
}

static bool stays(const gauges_t *g, const double *v, const double *a, double top) {
    coordinates_t next = {0}, later = {0};
    sum(g->n, v, g->period, a, next);
    run_out(g, next, a, later);
    return gauge(g, VELOCITY, next) <= top && gauge(g, VELOCITY, later) <= top;
}

void advance(const gauges_t *g, const double *v, const double *a, const double *wanted, double top,
             double *found) {
    coordinates_t go = {0}, base = {0}, way = {0};
    saturate(g, a, wanted, go);
    if (stays(g, v, go, top)) {
        memcpy(found, go, (size_t)g->n * sizeof(double));
        return;
    }
    double cycles = gauge(g, JERK, a) / g->period, low = 0.0, high = 1.0;
    for (index_t i = 0; i < g->n; i++) {
        base[i] = cycles > 1.0 ? (1.0 - 1.0 / cycles) * a[i] : 0.0;
        way[i] = go[i] - base[i];
    }
    for (int k = 0; k < BISECTIONS; k++) {
        double middle = 0.5 * (low + high);
        sum(g->n, base, middle, way, go);
        if (stays(g, v, go, top))
            low = middle;
        else
            high = middle;
    }
    sum(g->n, base, low, way, found);
}

/* Write the acceleration, relative to b's reference, that makes up for a velocity u soonest.
 *
 * Straight to a turning point, from there straight to zero; a halved fixed-point iteration finds
 * the point.  The result is at most slope times u. */
static void make_up(const gauges_t *g, const double *u, const double *b, double slope,
                    const double *spare, double *found) {
    double h = g->period;
    coordinates_t x = {0}, change = {0};
    memcpy(x, u, (size_t)g->n * sizeof(double));
    for (int left = TURNING_POINT_ROUNDS;; left--) {
        double jerk = gauge(g, JERK, x), s = 0.0;
        if (jerk > NOTHING) {
            s = first_change(1.0 / h, spare[JERK] * h / jerk);
            s = smaller(smaller(s, spare[ACCELERATION] / gauge(g, ACCELERATION, x)), slope);
        }
        for (index_t i = 0; i < g->n; i++)
            found[i] = s * x[i], change[i] = found[i] - b[i];
        double t = 0.5 * (gauge(g, JERK, change) / spare[JERK] - h);
        if (!left || t <= 0.0)
            return;
        for (index_t i = 0; i < g->n; i++)
            x[i] = 0.5 * (x[i] + u[i] - t * (b[i] + found[i]));
    }
}

static const double ALL[RATES] = {1.0, 1.0, 1.0};

/* Write the acceleration to aim at, to be at rest soonest. */
static void rest(const gauges_t *g, const double *v, const double *a, double *wanted) {
    coordinates_t back = {0};
    for (index_t i = 0; i < g->n; i++)
        back[i] = -v[i];
    make_up(g, back, a, 1.0 / g->period, ALL, wanted);
}

void halt(const gauges_t *g, const double *v, const double *a, const double *aside, double *found) {
    coordinates_t wanted = {0};
    rest(g, v, a, wanted);
    if (aside != NULL)
        sum(g->n, wanted, 1.0, aside, wanted);
    advance(g, v, a, wanted, loosened(g, v, a), found);
}

/* A line to the reference, and what is known along it. */
typedef struct { double along, way, known, acceleration, jerk, period; } line_t;

/* By how much a relative stop after a step with an acceleration passes the reference. */
static double excess(const line_t *line, double rate) {
    double h = line->period;
    double speed = line->along + 0.5 * h * rate;
    return stop_along(speed, rate, line->acceleration, line->jerk).way - line->way + h * h * rate / 6.0;
}

/* Write the largest part of the way from braking to going whose stop does not pass the reference. */
static void brake_in_time(const line_t *line, index_t n, const double *f, const double *go,
                          const double *brake, double *found) {
    double fast = inner(n, f, go) - line->known, slow = inner(n, f, brake) - line->known;
    double over = excess(line, fast), under = excess(line, slow), low = 0.0, high = 1.0;
    if (over <= 0.0 || under >= 0.0) {
        memcpy(found, over <= 0.0 ? go : brake, (size_t)n * sizeof(double));
        return;
    }
    for (int k = 0; k < SECANTS; k++) {
        double share = low + (high - low) * under / (under - over);
        double value = excess(line, slow + share * (fast - slow));
        if (value > 0.0)
            high = share, over = value;
        else
            low = share, under = value;
    }
    for (index_t i = 0; i < n; i++)
        found[i] = brake[i] + low * (go[i] - brake[i]);
}

void keep_distance(const gauges_t *g, double slack, const double *e, const double *v,
                   const double *a, const double *vr, const double *ar, double *wanted) {
    index_t n = g->n;
    double h = g->period, speed = sqrt(inner(n, v, v));
    coordinates_t u = {0}, go = {0}, brake = {0};
    if (speed * h < STANDING)
        return;
    for (index_t i = 0; i < n; i++)
        u[i] = v[i] / speed;
    double most = 1.0 / gauge(g, ACCELERATION, u), jerk = 1.0 / gauge(g, JERK, u);
    double way = inner(n, u, e), pace = inner(n, u, vr);
    if (pace > 0.0)
        way += stop_along(pace, larger(-most, smaller(inner(n, u, ar), most)), most, jerk).way;
    way = (way + slack) / (1.0 - LOOSE);
    saturate(g, a, wanted, go);
    double rate = inner(n, u, go), far = stop_along(speed + 0.5 * h * rate, rate, most, jerk).way;
    if (far <= way)
        return;
    rest(g, v, a, brake);
    saturate(g, a, brake, brake);
    rate = inner(n, u, brake);
    double near = stop_along(speed + 0.5 * h * rate, rate, most, jerk).way;
    double share = far > near ? larger(way - near, 0.0) / (far - near) : 0.0;
    for (index_t i = 0; i < n; i++)
        wanted[i] = brake[i] + share * (go[i] - brake[i]);
}

bool pursue(const gauges_t *g, const manner_t *manner, const calm_t *calm, const double *e,
            const double *v, const double *a, const double *vr, const double *ar, double *wanted) {
    index_t n = g->n;
    double h = g->period;
    const double *spare = manner->spare;
    coordinates_t closing = {0}, bend = {0}, f = {0}, goal = {0}, go = {0}, brake = {0};
    sum(n, v, -1.0, vr, closing), sum(n, a, -1.0, ar, bend);
    /* The way that is left after the relative acceleration has run out. */
    double t = gauge(g, JERK, bend) / spare[JERK];
    double s = h - t, r = -h * h / 6.0 - t * t / 3.0 + 0.5 * h * t;
    for (index_t i = 0; i < n; i++)
        f[i] = e[i] + s * closing[i] + r * bend[i];
    double left = sqrt(inner(n, f, f)), speed = sqrt(inner(n, closing, closing));
    if (left < NOTHING) {
        for (index_t i = 0; i < n; i++)
            goal[i] = -closing[i];
        make_up(g, goal, bend, manner->settle, spare, go);
        sum(n, ar, 1.0, go, wanted);
        return true;
    }
    for (index_t i = 0; i < n; i++)
        f[i] /= left;
    double most = spare[ACCELERATION] / gauge(g, ACCELERATION, f);
    double jerk = spare[JERK] / gauge(g, JERK, f), settle = manner->settle;
    s = closing_speed(left, most, jerk);
    double slow = CALM * smaller(most / settle, jerk / settle / settle);
    if ((manner->approach * left <= s && speed <= larger(s, slow))
        || (calm != NULL && calm->margin < INFINITY && left < calm->near)) {
        double pull = manner->approach * left;
        if (calm != NULL)
            pull = smaller(pull, sqrt(calm->margin * left));
        for (index_t i = 0; i < n; i++) {
            double change = settle * (pull * f[i] - closing[i]) - bend[i];
            wanted[i] = a[i] + manner->share * change;
        }
        return true;
    }
    s = smaller(manner->approach * left, s);
    double along = inner(n, f, closing), across = sqrt(larger(speed * speed - along * along, 0.0));
    s *= 1.0 - SPIRAL * across / (across + s);
    sum(n, vr, s, f, goal);
    double scale = 1.0 / larger(gauge(g, VELOCITY, goal), 1.0);
    for (index_t i = 0; i < n; i++)
        goal[i] = scale * goal[i] - v[i];
    make_up(g, goal, bend, settle, spare, go), sum(n, ar, 1.0, go, go);
    saturate(g, a, go, go);
    for (index_t i = 0; i < n; i++)
        goal[i] = -closing[i];
    make_up(g, goal, bend, 1.0 / h, spare, brake), sum(n, ar, 1.0, brake, brake);
    saturate(g, a, brake, brake);
    line_t line = {along, inner(n, f, e), inner(n, f, ar), most, jerk, h};
    brake_in_time(&line, n, f, go, brake, wanted);
    return false;
}
