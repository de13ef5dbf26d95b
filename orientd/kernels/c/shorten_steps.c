/* The steps by which a connector is shortened. */
#include <string.h>

#include "shorten.h"

#define FIRST_WEIGHT 0.5    /* of the barrier, of all limits together, as a share of the duration */
#define LAST_WEIGHT 1e-3
#define CLOSE_ENOUGH 2e-3   /* share of the duration that may be left */
#define LEAST_SLACK 0.05    /* to begin with */
#define TO_BOUNDARY 0.95    /* of the way */
#define LONGEST_STEP 0.3    /* of the duration */
#define SHORT_STEP 1e-3     /* share of a step that is not worth another one */
#define HEAVY 1.25          /* weight of a limit that leaves no room to move along it */
#define RIDGE 3e-4          /* on the diagonal, next to values of the order of one: control points
                             * with few limits would else step too far for the orientation */
#define MISSED_FIRST 1e-3   /* share of a limit, and rad, that may be missed on the way */
#define MISSED 1e-4         /* the same in the end */
#define ARRIVED 1e-12       /* rad, in the end */

enum { STEPS = 20, LAST_STEPS = 8, KINDS = 4 };

/* A limit of the norm of a rate, or of a component; or of the duration.
 *
 * ratio: what the rate is multiplied by to be a share of the limit.
 * value: its square less 1, and while a step is taken the change of the weight. */
typedef struct { double ratio, slack, weight, value, change; bool is_there; } limit_t;

typedef struct {
    spline_t *spline;
    limit_t limit[RATES][KINDS], longest, shortest;
    int limits;
    vec_t rate[RATES], by_duration[RATES];  /* in units of the first limit, and derivatives */
    double unit[RATES], power[3];           /* of the duration */
    double band[FREE][BAND];                /* upper part; row i from its diagonal on */
    double right[FREE][BORDER];
    double beside[FREE], corner, along, along_duration;
    double miss[3], turning[FREE][3], turning_by_duration[3];
} steps_t;

static int free_of(const spline_t *s) { return 3 * (s->elements - 2); }

/* Rates in units of their limits, and what limits are used. */
static void put_values(steps_t *at) {
    const spline_t *s = at->spline;
    at->power[0] = 1.0, at->power[1] = s->duration, at->power[2] = s->duration * s->duration;
    for (int i = 0; i < s->rates; i++) {
        const rate_t *rate = &s->rate[i];
        double unit = at->unit[i] / at->power[rate->order];
        vec_t v = vec(0.0, 0.0, 0.0);
        for (int k = 0; k < rate->count; k++)
            v = scaled_plus(rate->share[k], s->point[rate->first + k], v);
        at->rate[i] = v = times(unit, v);
        at->by_duration[i] = minus(times(unit, vec_at(rate->by_duration)),
                                   times(rate->order / s->duration, v));
        double parts[3] = {v.x, v.y, v.z};
        for (int k = 0; k < KINDS; k++) {
            limit_t *limit = &at->limit[i][k];
            double square = k ? parts[k - 1] * parts[k - 1] : dot(v, v);
            if (limit->is_there)
                limit->value = square * limit->ratio * limit->ratio - 1.0;
        }
    }
    at->longest.value = s->duration / s->most - 1.0;
    at->shortest.value = 1.0 - s->duration / s->least;
}

typedef struct { vec_t axis[3]; } axes_t;

/* The axes of a turned body. */
INLINE axes_t axes_of(quat_t q) {
    double xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z;
    double xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
    double wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
    return (axes_t){{vec(1.0 - 2.0 * (yy + zz), 2.0 * (xy + wz), 2.0 * (xz - wy)),
                     vec(2.0 * (xy - wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz + wx)),
                     vec(2.0 * (xz + wy), 2.0 * (yz - wx), 1.0 - 2.0 * (xx + yy))}};
}

/* Velocity inside an element. */
INLINE vec_t within(vec_t before, vec_t middle, vec_t after, double u) {
    double v = 1.0 - u;
    return plus(plus(times(v * v, before), times(2.0 * u * v, middle)), times(u * u, after));
}

/* Where the spline leads to, by the expansion of stop.c in the same parts, and how far that is from its
 * end, with derivatives. */
static void put_turning(steps_t *at) {
    spline_t *s = at->spline;
    int n = s->elements;
    const double node = sqrt(3.0) / 6.0;
    double T = s->duration;
    vec_t by_point[POINTS][3], by_duration = vec(0.0, 0.0, 0.0);
    memset(by_point, 0, sizeof by_point);
    quat_t here = s->node[0] = s->begin.q, back = conjugated(s->end.q);
    vec_t before = velocity_at(s, 0);
    axes_t from = axes_of(multiplied(back, here));
    for (int k = 0; k < n; k++) {
        double h = T * s->width[k];
        vec_t middle = s->point[k + 1], after = velocity_at(s, k + 1);
        double parts = fmin(parts_of(before, after, h, LONGEST_BENT), MOST_NODES), part = h / parts;
        for (int j = 0; j < (int)parts; j++) {
            vec_t a = within(before, middle, after, (j + 0.5 - node) / parts);
            vec_t b = within(before, middle, after, (j + 0.5 + node) / parts);
            vec_t half = plus(times(0.25 * part, plus(a, b)),
                              times(sqrt(3.0) / 24.0 * part * part, cross(a, b)));
            here = multiplied(here, exponential(half));
        }
        s->node[k + 1] = here;
        axes_t to = axes_of(multiplied(back, here));
        /* The share of each of three control points is centred at a place of its own. */
        double first = (k ? s->width[k] / s->sum[k] : 1.0) / 3.0;
        double last = (k + 1 < n ? s->width[k] / s->sum[k + 1] : 1.0) / 3.0;
        double shares[3] = {first, 1.0 - first - last, last}, places[3] = {0.25, 0.5, 0.75};
        for (int i = 0; i < 3; i++)
            for (int c = 0; c < 3; c++) {
                vec_t column = plus(times(1.0 - places[i], from.axis[c]),
                                    times(places[i], to.axis[c]));
                by_point[k + i][c] = scaled_plus(h * shares[i], column, by_point[k + i][c]);
            }
        vec_t mean = times(1.0 / 3.0, plus(plus(before, middle), after));
        for (int c = 0; c < 3; c++) {
            double part = 0.5 * s->width[k] * (c == 0 ? mean.x : c == 1 ? mean.y : mean.z);
            by_duration = scaled_plus(part, plus(from.axis[c], to.axis[c]), by_duration);
        }
        from = to;
        before = after;
    }
    vec_t given[2] = {times(0.5 * s->width[0], s->begin.alpha),
                      times(-0.5 * s->width[n - 1], s->end.alpha)};
    for (int end = 0; end < 2; end++) {
        const vec_t *by = by_point[end ? n : 1];
        by_duration = scaled_plus(given[end].x, by[0], by_duration);
        by_duration = scaled_plus(given[end].y, by[1], by_duration);
        by_duration = scaled_plus(given[end].z, by[2], by_duration);
    }
    put_vec(at->turning_by_duration, by_duration);
    for (int k = 2; k < n; k++)
        for (int c = 0; c < 3; c++)
            put_vec(at->turning[3 * (k - 2) + c], by_point[k][c]);
    put_vec(at->miss, times(2.0, logarithm(multiplied(back, here))));
}

/* The pull of a limit towards its inside, and its curvature, of the square of a rate. */
INLINE void take_limit(const limit_t *limit, double weight, double *pull, double *stiffness) {
    *stiffness = limit->weight / limit->slack;
    *pull = weight / limit->slack + *stiffness * (limit->value + limit->slack);
}

/* Fill band and border. */
static void put_matrix(steps_t *at, double weight) {
    const spline_t *s = at->spline;
    int rows = free_of(s);
    memset(at->band, 0, sizeof at->band[0] * (size_t)rows);
    memset(at->right, 0, sizeof at->right[0] * (size_t)rows);
    memset(at->beside, 0, sizeof at->beside);
    at->corner = at->along_duration = 0.0;
    for (int i = 0; i < s->rates; i++) {
        const rate_t *rate = &s->rate[i];
        double v[3], p[3][3] = {{0.0}}, pull[3] = {0.0}, by[3];
        put_vec(v, at->rate[i]), put_vec(by, at->by_duration[i]);
        for (int k = 0; k < KINDS; k++) {
            const limit_t *limit = &at->limit[i][k];
            if (!limit->is_there)
                continue;
            double square = limit->ratio * limit->ratio, y, stiffness;
            take_limit(limit, weight, &y, &stiffness);
            double bend = 2.0 * limit->weight * square, turn = 4.0 * stiffness * square * square;
            for (int c = k ? k - 1 : 0; c < (k ? k : 3); c++) {
                pull[c] += 2.0 * square * y * v[c];
                p[c][c] += bend;
                for (int d = k ? k - 1 : 0; d < (k ? k : 3); d++)
                    p[c][d] += turn * v[c] * v[d];
            }
        }
        double unit = at->unit[i] / at->power[rate->order], pushed[3];
        for (int c = 0; c < 3; c++) {
            pushed[c] = p[c][0] * by[0] + p[c][1] * by[1] + p[c][2] * by[2];
            at->corner += by[c] * pushed[c];
            at->along_duration += by[c] * pull[c];
        }
        for (int a = 0; a < rate->count; a++) {
            int one = rate->first + a - 2;
            if (one < 0 || one >= s->elements - 2)
                continue;
            double share = unit * rate->share[a];
            for (int c = 0; c < 3; c++) {
                at->right[3 * one + c][0] -= share * pull[c];
                at->right[3 * one + c][1] += share * pushed[c];
            }
            for (int b = a; b < rate->count; b++) {
                int other = rate->first + b - 2;
                if (other >= s->elements - 2)
                    continue;
                double both = share * unit * rate->share[b];
                for (int c = 0; c < 3; c++)
                    for (int d = a == b ? c : 0; d < 3; d++)
                        at->band[3 * one + c][3 * (other - one) + d - c] += both * p[c][d];
            }
        }
    }
    for (int r = 0; r < rows; r++) {
        at->band[r][0] += RIDGE;
        at->beside[r] = at->right[r][1];
        for (int k = 0; k < 3; k++)
            at->right[r][2 + k] = at->turning[r][k];
    }
    const limit_t *ends[2] = {&at->longest, &at->shortest};
    double slopes[2] = {1.0 / s->most, -1.0 / s->least};
    for (int k = 0; k < 2; k++) {
        double y, stiffness;
        take_limit(ends[k], weight, &y, &stiffness);
        at->along_duration += slopes[k] * y;
        at->corner += slopes[k] * slopes[k] * stiffness;
    }
}

/* Solve the band for all right sides, by Cholesky's method; false if it is not positive. */
static bool solve_band(steps_t *at) {
    int rows = free_of(at->spline);
    for (int r = 0; r < rows; r++) {
        double *row = at->band[r], *right = at->right[r];
        if (!(row[0] > 0.0 && row[0] < INFINITY))
            return false;
        double per = 1.0 / row[0];
        int reach = (int)least(BAND, rows - r);
        for (int k = 1; k < reach; k++) {
            double factor = row[k] * per, *below = at->band[r + k];
            for (int j = k; j < reach; j++)
                below[j - k] -= factor * row[j];
            for (int c = 0; c < BORDER; c++)
                at->right[r + k][c] -= factor * right[c];
        }
    }
    for (int r = rows - 1; r >= 0; r--) {
        double *row = at->band[r], *right = at->right[r];
        int reach = (int)least(BAND, rows - r);
        for (int k = 1; k < reach; k++)
            for (int c = 0; c < BORDER; c++)
                right[c] -= row[k] * at->right[r + k][c];
        for (int c = 0; c < BORDER; c++)
            right[c] /= row[0];
    }
    return true;
}

/* Solve a small system by elimination with row exchanges; false where it is singular. */
static bool solve_small(int n, double a[4][5]) {
    for (int i = 0; i < n; i++) {
        int best = i;
        for (int r = i + 1; r < n; r++)
            if (fabs(a[r][i]) > fabs(a[best][i]))
                best = r;
        if (!(fabs(a[best][i]) > 0.0))
            return false;
        for (int c = 0; c <= n; c++) {
            double held = a[i][c];
            a[i][c] = a[best][c], a[best][c] = held;
        }
        for (int r = 0; r < n; r++)
            for (int c = n; c >= i && r != i; c--)
                a[r][c] -= a[r][i] / a[i][i] * a[i][c];
    }
    for (int i = 0; i < n; i++)
        a[i][n] /= a[i][i];
    return true;
}

/* The step of the control points, into the first right side, and of the duration.
 *
 * to: the duration to go to, or 0 to make it shorter. */
static bool put_step(steps_t *at, double to, double *step) {
    const spline_t *s = at->spline;
    int rows = free_of(s);
    if (!solve_band(at))
        return false;
    /* Unknown: the duration's step, and what holds the orientation. */
    double a[4][5] = {{0.0}};
    a[0][0] = at->corner;
    a[0][4] = -(1.0 / s->most + at->along_duration);
    for (int k = 0; k < 3; k++) {
        a[0][1 + k] = a[1 + k][0] = at->turning_by_duration[k];
        a[1 + k][4] = -at->miss[k];
    }
    for (int r = 0; r < rows; r++) {
        const double *x = at->right[r], *turning = at->turning[r];
        a[0][0] -= at->beside[r] * x[1];
        a[0][4] -= at->beside[r] * x[0];
        for (int k = 0; k < 3; k++) {
            a[0][1 + k] -= at->beside[r] * x[2 + k];
            a[1 + k][0] -= turning[k] * x[1];
            a[1 + k][4] -= turning[k] * x[0];
            for (int j = 0; j < 3; j++)
                a[1 + k][1 + j] -= turning[k] * x[2 + j];
        }
    }
    if (to > 0.0) {
        a[0][0] = 1.0, a[0][1] = a[0][2] = a[0][3] = 0.0;
        a[0][4] = to - s->duration;
    }
    if (!solve_small(4, a))
        return false;
    *step = a[0][4];
    for (int r = 0; r < rows; r++) {
        double *x = at->right[r];
        x[0] -= x[1] * a[0][4] + x[2] * a[1][4] + x[3] * a[2][4] + x[4] * a[3][4];
    }
    return true;
}

/* How far steps of slack and weight go, and how much each changes; updates the shares to go. */
static void take_step(limit_t *limit, double change, double weight, double *go, double *go_dual) {
    limit->change = -(limit->value + limit->slack) - change;
    double dual = (weight - limit->weight * limit->change) / limit->slack - limit->weight;
    if (limit->change < 0.0)
        *go = fmin(*go, -TO_BOUNDARY * limit->slack / limit->change);
    if (dual < 0.0)
        *go_dual = fmin(*go_dual, -TO_BOUNDARY * limit->weight / dual);
    /* Held until it is known how far to go. */
    limit->value = dual;
}

INLINE void move_limit(limit_t *limit, double go, double go_dual) {
    limit->slack += go * limit->change;
    limit->weight += go_dual * limit->value;
}

/* Take one step and return the share of it that was possible, or 0 if there is no step. */
static double advance(steps_t *at, double weight, double to) {
    spline_t *s = at->spline;
    double step, go = 1.0, go_dual = 1.0;
    put_matrix(at, weight);
    if (!put_step(at, to, &step) || !(fabs(step) < INFINITY))
        return 0.0;
    for (int i = 0; i < s->rates; i++) {
        const rate_t *rate = &s->rate[i];
        double unit = at->unit[i] / at->power[rate->order], v[3], d[3];
        vec_t change = times(step, at->by_duration[i]);
        for (int k = 0; k < rate->count; k++) {
            int one = 3 * (rate->first + k - 2);
            if (one < 0 || one >= free_of(s))
                continue;
            change = scaled_plus(unit * rate->share[k], vec(at->right[one][0],
                                 at->right[one + 1][0], at->right[one + 2][0]), change);
        }
        put_vec(v, at->rate[i]), put_vec(d, change);
        for (int k = 0; k < KINDS; k++)
            if (at->limit[i][k].is_there) {
                double ratio = at->limit[i][k].ratio;
                double along = k ? v[k - 1] * d[k - 1] : v[0] * d[0] + v[1] * d[1] + v[2] * d[2];
                take_step(&at->limit[i][k], 2.0 * along * ratio * ratio, weight, &go, &go_dual);
            }
    }
    take_step(&at->longest, step / s->most, weight, &go, &go_dual);
    take_step(&at->shortest, -step / s->least, weight, &go, &go_dual);
    go = fmin(go, LONGEST_STEP * s->duration / fabs(step));
    for (int i = 0; i < s->rates; i++)
        for (int k = 0; k < KINDS; k++)
            if (at->limit[i][k].is_there)
                move_limit(&at->limit[i][k], go, go_dual);
    move_limit(&at->longest, go, go_dual), move_limit(&at->shortest, go, go_dual);
    s->duration = to > 0.0 && go == 1.0 ? to : s->duration + go * step;
    put_given(s);
    for (int k = 2; k < s->elements; k++) {
        const double (*by)[BORDER] = (const double (*)[BORDER])at->right + 3 * (k - 2);
        s->point[k] = scaled_plus(go, vec(by[0][0], by[1][0], by[2][0]), s->point[k]);
    }
    put_values(at);
    put_turning(at);
    return fmin(go, go_dual);
}

/* Sum of the products of slack and weight; the largest share above a limit is put in *above*. */
static double gap_of(const steps_t *at, double *above) {
    const spline_t *s = at->spline;
    double gap = at->longest.slack * at->longest.weight + at->shortest.slack * at->shortest.weight;
    *above = fmax(at->longest.value, at->shortest.value);
    for (int i = 0; i < s->rates; i++)
        for (int k = 0; k < KINDS; k++)
            if (at->limit[i][k].is_there) {
                gap += at->limit[i][k].slack * at->limit[i][k].weight;
                *above = fmax(*above, at->limit[i][k].value);
            }
    return gap;
}

/* The largest weight: how much a limit lengthens the spline. */
static double heaviest(const steps_t *at) {
    double weight = 0.0;
    for (int i = 0; i < at->spline->rates; i++)
        for (int k = 0; k < KINDS; k++)
            if (at->limit[i][k].is_there)
                weight = fmax(weight, at->limit[i][k].weight);
    return weight;
}

static double missed(const steps_t *at) { return norm(vec_at(at->miss)); }

static void put_weights(steps_t *at) {
    const spline_t *s = at->spline;
    at->limits = 2;
    for (int i = 0; i < s->rates; i++) {
        const double *most = s->bounds.most[s->rate[i].order];
        at->unit[i] = 1.0 / fmin(fmin(most[0], most[1]), fmin(most[2], most[3]));
        for (int k = 0; k < KINDS; k++) {
            /* A component that may be as large as the norm is not limited by itself. */
            at->limit[i][k].is_there = most[k] < INFINITY && (!k || most[k] < most[0]);
            at->limit[i][k].ratio = 1.0 / (most[k] * at->unit[i]);
            at->limits += at->limit[i][k].is_there;
        }
    }
    put_values(at);
    double weight = FIRST_WEIGHT / at->limits;
    for (int i = 0; i < s->rates; i++)
        for (int k = 0; k < KINDS; k++) {
            limit_t *limit = &at->limit[i][k];
            limit->slack = fmax(-limit->value, LEAST_SLACK);
            limit->weight = weight / limit->slack;
        }
    at->longest.slack = at->shortest.slack = LEAST_SLACK;
    at->shortest.slack = fmax(-at->shortest.value, LEAST_SLACK);
    at->longest.weight = weight / at->longest.slack;
    at->shortest.weight = weight / at->shortest.slack;
}

/* Move the control points by as little as brings the spline to its end. */
static bool arrive(steps_t *at) {
    spline_t *s = at->spline;
    for (int step = 0; step < LAST_STEPS && missed(at) > ARRIVED; step++) {
        double a[4][5] = {{0.0}};
        for (int k = 0; k < 3; k++) {
            a[k][3] = -at->miss[k];
            for (int r = 0; r < free_of(s); r++)
                for (int j = 0; j < 3; j++)
                    a[k][j] += at->turning[r][k] * at->right[r][2 + j];
        }
        if (!solve_small(3, a))
            return false;
        for (int k = 2; k < s->elements; k++) {
            double change[3] = {0.0};
            for (int c = 0; c < 3; c++)
                for (int j = 0; j < 3; j++)
                    change[c] += at->right[3 * (k - 2) + c][2 + j] * a[j][3];
            s->point[k] = plus(s->point[k], vec_at(change));
        }
        put_turning(at);
    }
    return missed(at) <= ARRIVED;
}

outcome_t shorten(spline_t *spline, double period) {
    steps_t at;
    bool is_free = false;
    at.spline = spline;
    put_given(spline);
    put_weights(&at);
    put_turning(&at);
    double gap, above, share = 1.0, gone = 0.5;
    for (int step = 0;; step++) {
        gap = gap_of(&at, &above);
        bool is_inside = above < MISSED_FIRST && missed(&at) < MISSED_FIRST;
        bool is_short = gone > TO_BOUNDARY - 0.2 && gap < CLOSE_ENOUGH;
        /* Control points that get no shorter may still form a connector. */
        if ((is_inside && is_short) || step == STEPS || !(gone > SHORT_STEP)) {
            is_free = is_inside && is_short && heaviest(&at) < HEAVY;
            break;
        }
        share = step == 0 ? 1.0 : gone > 0.9 ? 0.1 : gone > 0.5 ? 0.3 : 0.6;
        gone = advance(&at, fmax(share * gap, LAST_WEIGHT) / at.limits, 0.0);
    }
    /* The barrier of the least duration is no reason for another period. */
    bool is_least = spline->duration < (1.0 + CLOSE_ENOUGH) * spline->least;
    double goal = ceil((is_least ? spline->least : spline->duration) / period - 1e-9) * period;
    for (int step = 0; step < LAST_STEPS; step++) {
        gone = advance(&at, fmax(gap, LAST_WEIGHT) / at.limits, goal);
        if (!(gone > 0.0))
            return LOST;
        gap_of(&at, &above);
        if (spline->duration == goal && above < MISSED && missed(&at) < MISSED)
            return !arrive(&at) ? LOST : is_free ? CONVERGED : STUCK;
    }
    return LOST;
}
