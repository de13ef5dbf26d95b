/* The quickest profile of a path by a logarithmic barrier and Newton's method.
 *
 * The search checks the limits at the beginning, middle and end of each element, from inside.
 * Simpson's rule on each element gives the duration.  Every step computes new tangents of the jerk's
 * limit.  Each Hessian has five diagonals, so the cost of a step is proportional to the number of
 * elements.
 *
 * The limits in the Hessian have multipliers of their own, as in a primal-dual method (Nocedal and
 * Wright, Numerical Optimization, 2006, chapter 19).  Without them the first step after a lower weight
 * of the barrier is many times too long, and so is the first one from a profile that is much closer
 * to some limits than to others.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "profile.h"

enum {
    SPOTS = 3,   /* of an element */
    BENDS = 5 + MOST_AXES,   /* limits of accelerations, at most */
    TWISTS = 4 + MOST_AXES,  /* of jerks */
};

/* The rows of numbers of a search: n or n + 1 or n + 2 each. */
typedef struct {
    const profile_path_t *path;
    index_t n;
    const double *h;
    double *near, *far, *rise;        /* value and slope at a node from two coefficients */
    double *value, *slope;            /* of a profile at the nodes */
    double *y[SPOTS], *d[SPOTS], *b;  /* value, slope and bend in the elements */
    /* Each limit has two rows after its numbers: one over its slack, and its multiplier. */
    double *top[SPOTS][3];            /* one over the largest y */
    double *bends[SPOTS][BENDS][5];   /* products of the columns of a limited rate */
    double *twists[SPOTS][TWISTS][8];
    int bend_count, twist_count;
    double weight;                    /* of the barrier, when the search ended */
    double *memory;
    double *g[3], *m[6];              /* gradient and Hessian at one spot of the elements */
    double *lg[3], *lm[6];            /* the same by the three coefficients of each element */
    double *diagonal, *beside, *apart, *right, *step, *trial, *slack;
} search_t;

enum {
    MOST_STEPS = 240,
    ROUND_STEPS = 40,
    FIRST_STEPS = 80,
    HALVINGS = 40,
};

#define REDUCTION 0.1     /* of the barrier's weight from one round to the next */
#define DECREMENT 10.0    /* of a round's weight, squared */
#define CLOSER 0.3        /* the same where a round has not moved the profile at all */
#define INSIDE 0.995      /* share of the limits up to which they need not be moved out */
#define STRETCH 1.05      /* how far beyond the largest share they are moved */
#define SLOWER 0.98       /* share of the limits that a guess is slowed down to */
#define NEAR 1.0005       /* how far beyond the largest share limits stay when they are moved in */
#define FAR 0.3           /* share of the duration to begin with where that cannot be */
#define NEARLY 1.25       /* times the share to end with is near enough */
#define LIFT 1e-12        /* of the diagonal, against rounding */
#define LOST 1e-15        /* share of the diagonal below which a pivot is rounding */
#define HUGE_PIVOT 1e150
#define APART 30.0        /* between a multiplier and what the slack says of it, as a factor */
#define UNKNOWN 1e100

/* Shares of the duration of an element, by Simpson. */
static const double simpson[SPOTS] = {1.0 / 6, 4.0 / 6, 1.0 / 6};


static index_t rows_of_search(int bends, int twists) {
    return 3 + 2 + 2 * SPOTS + 1 + SPOTS * (3 + 5 * bends + 8 * twists) + 9 + 9 + 7;
}

/* Products of the contributions of y, y' and y'' to a rate at a place, in units of the limit. */
static void put_products(const rate_t *rate, const double *p, const double *pp, const double *ppp,
                         double aim, double *to) {
    double scale = aim / rate->limit, columns[3][3];
    for (index_t k = 0; k < 3; k++) {
        bool counts = rate->axis == ALL_AXES || rate->axis == k;
        double one = counts ? scale * p[k] : 0.0, two = counts ? scale * pp[k] : 0.0;
        double three = counts ? scale * ppp[k] : 0.0;
        columns[0][k] = rate->order == 1 ? one : rate->order == 2 ? two : three;
        columns[1][k] = rate->order == 2 ? 0.5 * one : 1.5 * two;
        columns[2][k] = 0.5 * one;
    }
    int place = 0;
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++)
            to[place++] = columns[i][0] * columns[j][0] + columns[i][1] * columns[j][1]
                        + columns[i][2] * columns[j][2];
}

static void put_path(search_t *s, const rate_t *rates, int count) {
    const profile_path_t *path = s->path;
    index_t n = s->n;
    for (index_t i = 0; i <= n; i++) {
        double before = i ? s->h[i - 1] : 0.0, after = i < n ? s->h[i] : 0.0;
        double sum = before + after;
        s->near[i] = after / sum, s->far[i] = before / sum, s->rise[i] = 2.0 / sum;
    }
    for (int spot = 0; spot < SPOTS; spot++)
        memset(s->top[spot][0], 0, (size_t)n * sizeof(double));
    s->bend_count = s->twist_count = 0;
    for (int r = 0; r < count; r++) {
        const rate_t *rate = &rates[r];
        const double *aims = row_of(path->aims, rate->order - 1);
        for (int spot = 0; spot < SPOTS; spot++)
            for (index_t e = 0; e < n; e++) {
                const double *p = rate->first + 6 * e, *q = rate->second + 6 * e;
                double third[3], products[6];
                for (index_t k = 0; k < 3; k++) {
                    double change = q[k + 6] - q[k], rest = 2.0 * (q[k] + q[k + 6]) - 4.0 * q[k + 3];
                    third[k] = (change + (spot - 1) * rest) / s->h[e];
                }
                put_products(rate, p + 3 * spot, q + 3 * spot, third, aims[e], products);
                if (rate->order == 1)
                    s->top[spot][0][e] = larger(products[0], s->top[spot][0][e]);
                else if (rate->order == 2) {
                    double **to = s->bends[spot][s->bend_count];
                    to[0][e] = products[0], to[1][e] = products[1], to[2][e] = products[3];
                } else
                    for (int k = 0; k < 6; k++)
                        s->twists[spot][s->twist_count][k][e] = products[k];
            }
        s->bend_count += rate->order == 2, s->twist_count += rate->order == 3;
    }
}

static void spread(const search_t *s, const double *restrict c) {
    double *restrict value = s->value, *restrict slope = s->slope, *restrict b = s->b;
    double *const *y = s->y, *const *d = s->d;
    INDEPENDENT
    for (index_t i = 0; i <= s->n; i++) {
        value[i] = s->near[i] * c[i] + s->far[i] * c[i + 1];
        slope[i] = s->rise[i] * (c[i + 1] - c[i]);
    }
    INDEPENDENT
    for (index_t e = 0; e < s->n; e++) {
        double h = s->h[e];
        b[e] = (slope[e + 1] - slope[e]) / h;
        y[0][e] = value[e], y[2][e] = value[e + 1];
        d[0][e] = slope[e], d[2][e] = slope[e + 1];
        y[1][e] = value[e] + 0.125 * h * (3.0 * slope[e] + slope[e + 1]);
        d[1][e] = 0.5 * (slope[e] + slope[e + 1]);
    }
}

static double duration(const search_t *s) {
    double *restrict part = s->slack, sum = 0.0;
    const double *restrict h = s->h;
    const double *restrict a = s->y[0], *restrict b = s->y[1], *restrict c = s->y[2];
    INDEPENDENT
    for (index_t e = 0; e < s->n; e++)
        part[e] = h[e] * (simpson[0] / sqrt(a[e]) + simpson[1] / sqrt(b[e])
                          + simpson[2] / sqrt(c[e]));
    for (index_t e = 0; e < s->n; e++)
        sum += part[e];
    return sum;
}

INLINE double length2(double *const g[3], index_t e, double y, double d) {
    return y * (g[0][e] * y + 2.0 * g[1][e] * d) + g[2][e] * d * d;
}

INLINE double length3(double *const g[6], index_t e, double y, double d, double b) {
    return y * (g[0][e] * y + 2.0 * (g[1][e] * d + g[2][e] * b))
         + d * (g[3][e] * d + 2.0 * g[4][e] * b) + g[5][e] * b * b;
}

/* The factor by which the spread profile exceeds the limits. */
static double largest_share(const search_t *s) {
    double largest = 0.0;
    for (int spot = 0; spot < SPOTS; spot++)
        for (index_t e = 0; e < s->n; e++) {
            double y = s->y[spot][e], d = s->d[spot][e];
            largest = larger(y * s->top[spot][0][e], largest);
            for (int k = 0; k < s->bend_count; k++)
                largest = larger(sqrt(larger(length2(s->bends[spot][k], e, y, d), 0.0)), largest);
            for (int k = 0; k < s->twist_count; k++)
                largest = larger(sqrt(larger(length3(s->twists[spot][k], e, y, d, s->b[e]) * y,
                                             0.0)), largest);
        }
    return largest;
}

static double cost_of(const search_t *s, double weight, double stretch) {
    double over = 1.0 / (stretch * stretch), barrier = 0.0, all = 1.0;
    index_t outside = 0, n = s->n;
    for (int spot = 0; spot < SPOTS; spot++) {
        const double *restrict y = s->y[spot], *restrict d = s->d[spot], *restrict b = s->b;
        const double *restrict top = s->top[spot][0];
        double *restrict product = s->slack;
        INDEPENDENT
        for (index_t e = 0; e < n; e++) {
            product[e] = 1.0 - y[e] * top[e] / stretch;
            outside += !((product[e] > 0.0) & (y[e] > 0.0));
        }
        for (int k = 0; k < s->bend_count; k++) {
            const double *restrict aa = s->bends[spot][k][0], *restrict ab = s->bends[spot][k][1];
            const double *restrict bb = s->bends[spot][k][2];
            INDEPENDENT
            for (index_t e = 0; e < n; e++) {
                double square = y[e] * (aa[e] * y[e] + 2.0 * ab[e] * d[e]) + bb[e] * d[e] * d[e];
                double slack = 1.0 - square * over;
                outside += !(slack > 0.0);
                product[e] *= slack;
            }
        }
        for (int k = 0; k < s->twist_count; k++) {
            double *const *of = s->twists[spot][k];
            const double *restrict aa = of[0], *restrict ab = of[1], *restrict ac = of[2];
            const double *restrict bb = of[3], *restrict bc = of[4], *restrict cc = of[5];
            INDEPENDENT
            for (index_t e = 0; e < n; e++) {
                double square = y[e] * (aa[e] * y[e] + 2.0 * (ab[e] * d[e] + ac[e] * b[e]))
                              + d[e] * (bb[e] * d[e] + 2.0 * bc[e] * b[e]) + cc[e] * b[e] * b[e];
                double slack = 1.0 / y[e] - square * over;
                outside += !(slack > 0.0);
                product[e] *= slack;
            }
        }
        if (outside)
            return INFINITY;
        /* One logarithm for many factors. */
        for (index_t e = 0; e < n; e++) {
            all *= product[e];
            if (all < 1e-150 || all > 1e150)
                barrier += log(all), all = 1.0;
        }
    }
    barrier += log(all);
    double cost = duration(s) - weight * barrier;
    return isnan(cost) ? INFINITY : cost;
}

/* A step of Newton's method: whether there was one, one over its length, and the weight it had. */
typedef struct { double counts, over, weight; } stride_t;

/* Return the multiplier of a limit after a step that has changed it as Newton's method does for
 * slack * multiplier = weight.
 *
 * now, over: the slack, and one over it.
 * before: one over the slack before the step.
 * last: the multiplier before it. */
INLINE double multiplier(double now, double over, double before, double last, stride_t stride) {
    double change = stride.weight * before - last - last * (now * before - 1.0) * stride.over;
    double next = last + stride.counts * change, middle = stride.weight * over;
    return larger(smaller(next, APART * middle), middle * (1.0 / APART));
}

/* Write gradient and Hessian at one spot of the elements by y, y' and y''.
 *
 * length: of the step before with this weight; 0 if there was none. */
static void differentiate(const search_t *s, int spot, double weight, double stretch,
                          double length) {
    stride_t stride = {length > 0.0, length > 0.0 ? 1.0 / length : 0.0, weight};
    double square = stretch * stretch, share = simpson[spot];
    const double *restrict y = s->y[spot], *restrict d = s->d[spot], *restrict b = s->b;
    const double *restrict top = s->top[spot][0], *restrict h = s->h;
    double *restrict before = s->top[spot][1], *restrict last = s->top[spot][2];
    double *restrict g0 = s->g[0], *restrict g1 = s->g[1], *restrict g2 = s->g[2];
    double *restrict m0 = s->m[0], *restrict m1 = s->m[1], *restrict m2 = s->m[2];
    double *restrict m3 = s->m[3], *restrict m4 = s->m[4], *restrict m5 = s->m[5];
    index_t n = s->n;
    INDEPENDENT
    for (index_t e = 0; e < n; e++) {
        double root = 1.0 / sqrt(y[e]), inverse = root * root, w = share * h[e];
        double now = stretch - y[e] * top[e], over = 1.0 / now, room = top[e] * over;
        double times = multiplier(now, over, before[e], last[e], stride);
        before[e] = over, last[e] = times;
        g0[e] = weight * room - 0.5 * w * root * inverse;
        m0[e] = times * top[e] * room + 0.75 * w * root * inverse * inverse;
        g1[e] = g2[e] = m1[e] = m2[e] = m3[e] = m4[e] = m5[e] = 0.0;
    }
    for (int k = 0; k < s->bend_count; k++) {
        const double *restrict aa = s->bends[spot][k][0], *restrict ab = s->bends[spot][k][1];
        const double *restrict bb = s->bends[spot][k][2];
        double *restrict before = s->bends[spot][k][3], *restrict last = s->bends[spot][k][4];
        INDEPENDENT
        for (index_t e = 0; e < n; e++) {
            double one = aa[e] * y[e] + ab[e] * d[e], two = ab[e] * y[e] + bb[e] * d[e];
            double now = square - y[e] * one - d[e] * two, over = 1.0 / now;
            double f = 2.0 * weight * over;
            g0[e] += f * one, g1[e] += f * two;
            double times = multiplier(now, over, before[e], last[e], stride);
            before[e] = over, last[e] = times;
            f = 2.0 * times;
            double ff = 2.0 * f * over;
            m0[e] += ff * one * one + f * aa[e];
            m1[e] += ff * one * two + f * ab[e];
            m3[e] += ff * two * two + f * bb[e];
        }
    }
    for (int k = 0; k < s->twist_count; k++) {
        double *const *of = s->twists[spot][k];
        const double *restrict aa = of[0], *restrict ab = of[1], *restrict ac = of[2];
        const double *restrict bb = of[3], *restrict bc = of[4], *restrict cc = of[5];
        double *restrict before = of[6], *restrict last = of[7];
        INDEPENDENT
        for (index_t e = 0; e < n; e++) {
            /* Of L(y)^2 - |v|^2, with the tangent of L in the Hessian. */
            double one = aa[e] * y[e] + ab[e] * d[e] + ac[e] * b[e];
            double two = ab[e] * y[e] + bb[e] * d[e] + bc[e] * b[e];
            double three = ac[e] * y[e] + bc[e] * d[e] + cc[e] * b[e];
            double inverse = 1.0 / y[e], limit = square * inverse;
            double now = limit - (y[e] * one + d[e] * two + b[e] * three), over = 1.0 / now;
            double f = weight * over;
            double u = -2.0 * one - limit * inverse, v = -2.0 * two, w = -2.0 * three;
            g0[e] -= f * u, g1[e] -= f * v, g2[e] -= f * w;
            f = multiplier(now, over, before[e], last[e], stride);
            before[e] = over, last[e] = f;
            double ff = f * over;
            m0[e] += ff * u * u + 2.0 * f * aa[e] - 0.5 * f * limit * inverse * inverse;
            m1[e] += ff * u * v + 2.0 * f * ab[e];
            m2[e] += ff * u * w + 2.0 * f * ac[e];
            m3[e] += ff * v * v + 2.0 * f * bb[e];
            m4[e] += ff * v * w + 2.0 * f * bc[e];
            m5[e] += ff * w * w + 2.0 * f * cc[e];
        }
    }
}

/* Add one spot to gradient and Hessian by the three coefficients of each element. */
static void add_spot(const search_t *s, int spot) {
    double u = 0.5 * spot;
    const double *restrict h = s->h, *restrict near = s->near, *restrict far = s->far;
    const double *restrict rise = s->rise;
    const double *restrict g0 = s->g[0], *restrict g1 = s->g[1], *restrict g2 = s->g[2];
    const double *restrict m0 = s->m[0], *restrict m1 = s->m[1], *restrict m2 = s->m[2];
    const double *restrict m3 = s->m[3], *restrict m4 = s->m[4], *restrict m5 = s->m[5];
    double *restrict to0 = s->lg[0], *restrict to1 = s->lg[1], *restrict to2 = s->lg[2];
    double *restrict t00 = s->lm[0], *restrict t01 = s->lm[1], *restrict t02 = s->lm[2];
    double *restrict t11 = s->lm[3], *restrict t12 = s->lm[4], *restrict t22 = s->lm[5];
    INDEPENDENT
    for (index_t e = 0; e < s->n; e++) {
        double a = rise[e], c = rise[e + 1], over = 1.0 / h[e], x = u * h[e];
        /* The contributions of the three coefficients to y, y' and y''. */
        double p2 = a * over, q2 = -(a + c) * over, r2 = c * over;
        double p1 = x * p2 - a, q1 = x * q2 + a, r1 = x * r2;
        double p0 = near[e] + x * (0.5 * x * p2 - a), q0 = far[e] + x * (0.5 * x * q2 + a);
        double r0 = 0.5 * x * r1;
        double mp0 = m0[e] * p0 + m1[e] * p1 + m2[e] * p2;
        double mp1 = m1[e] * p0 + m3[e] * p1 + m4[e] * p2;
        double mp2 = m2[e] * p0 + m4[e] * p1 + m5[e] * p2;
        double mq0 = m0[e] * q0 + m1[e] * q1 + m2[e] * q2;
        double mq1 = m1[e] * q0 + m3[e] * q1 + m4[e] * q2;
        double mq2 = m2[e] * q0 + m4[e] * q1 + m5[e] * q2;
        double mr0 = m0[e] * r0 + m1[e] * r1 + m2[e] * r2;
        double mr1 = m1[e] * r0 + m3[e] * r1 + m4[e] * r2;
        double mr2 = m2[e] * r0 + m4[e] * r1 + m5[e] * r2;
        to0[e] += p0 * g0[e] + p1 * g1[e] + p2 * g2[e];
        to1[e] += q0 * g0[e] + q1 * g1[e] + q2 * g2[e];
        to2[e] += r0 * g0[e] + r1 * g1[e] + r2 * g2[e];
        t00[e] += p0 * mp0 + p1 * mp1 + p2 * mp2;
        t01[e] += p0 * mq0 + p1 * mq1 + p2 * mq2;
        t02[e] += p0 * mr0 + p1 * mr1 + p2 * mr2;
        t11[e] += q0 * mq0 + q1 * mq1 + q2 * mq2;
        t12[e] += q0 * mr0 + q1 * mr1 + q2 * mr2;
        t22[e] += r0 * mr0 + r1 * mr1 + r2 * mr2;
    }
}

/* Keep a coefficient as it is. */
static void fix(search_t *s, index_t i) {
    s->right[i] = 0.0, s->diagonal[i] = 1.0, s->beside[i] = s->apart[i] = 0.0;
    if (i > 0)
        s->beside[i - 1] = 0.0;
    if (i > 1)
        s->apart[i - 2] = 0.0;
}

/* Write the step of Newton's method after a step of a length; return its squared decrement, or 0 if
 * there is no step. */
static double newton(search_t *s, double weight, double stretch, double length) {
    index_t n = s->n, count = n + 2;
    for (int k = 0; k < 6; k++)
        memset(s->lm[k], 0, (size_t)n * sizeof(double));
    for (int k = 0; k < 3; k++)
        memset(s->lg[k], 0, (size_t)n * sizeof(double));
    for (int spot = 0; spot < SPOTS; spot++) {
        differentiate(s, spot, weight, stretch, length);
        add_spot(s, spot);
    }
    for (index_t i = 0; i < count; i++)
        s->diagonal[i] = s->beside[i] = s->apart[i] = s->right[i] = 0.0;
    for (index_t e = 0; e < n; e++) {
        s->diagonal[e] += s->lm[0][e], s->beside[e] += s->lm[1][e], s->apart[e] += s->lm[2][e];
        s->diagonal[e + 1] += s->lm[3][e], s->beside[e + 1] += s->lm[4][e];
        s->diagonal[e + 2] += s->lm[5][e];
        for (int k = 0; k < 3; k++)
            s->right[e + k] -= s->lg[k][e];
    }
    if (s->path->has_start)
        fix(s, 0), fix(s, 1);
    if (s->path->has_end)
        fix(s, n), fix(s, n + 1);
    const double *right = s->right;
    double *step = s->step, *diagonal = s->diagonal, *beside = s->beside, *apart = s->apart;
    /* L D L^T in place: `beside` and `apart` become the columns of L, `diagonal` one over D. */
    double near = 0.0, near_scaled = 0.0, far = 0.0, far_scaled = 0.0, last = 0.0, last_scaled = 0.0;
    double one = 0.0, two = 0.0;
    for (index_t i = 0; i < count; i++) {
        double pivot = diagonal[i] * (1.0 + LIFT) - near_scaled * near - far_scaled * far;
        double side = beside[i] - last_scaled * near, over = 1.0 / pivot;
        /* Where rounding has eaten up the curvature it stays as it is. */
        bool is_lost = !(pivot > LOST * diagonal[i] && pivot < HUGE_PIVOT);
        double next = right[i] - near * one - far * two;
        step[i] = next, two = one, one = next;
        far = last, far_scaled = last_scaled;
        near_scaled = is_lost ? 0.0 : side, last_scaled = is_lost ? 0.0 : apart[i];
        diagonal[i] = is_lost ? 1.0 / HUGE_PIVOT : over;
        beside[i] = near = near_scaled * diagonal[i];
        apart[i] = last = last_scaled * diagonal[i];
    }
    one = two = 0.0;
    for (index_t i = count - 1; i >= 0; i--) {
        double next = step[i] * diagonal[i] - beside[i] * one - apart[i] * two;
        step[i] = next, two = one, one = next;
    }
    double decrement = 0.0;
    for (index_t i = 0; i < count; i++)
        decrement += step[i] * right[i];
    return decrement;
}

/* Move towards the best profile for a weight, and return how many steps that took.
 *
 * near: squared decrement, as a share of the weight, from which on the profile is near enough.
 * most: the most steps. */
static int centre(search_t *s, double *c, double weight, double stretch, double near, int most) {
    index_t count = s->n + 2;
    spread(s, c);
    double cost = cost_of(s, weight, stretch);
    double length = 0.0;
    int steps = 0;
    while (steps < most) {
        double decrement = newton(s, weight, stretch, length);
        length = 1.0;
        steps++;
        if (!(decrement > near * weight))
            break;
        for (int k = 0; k < HALVINGS; k++, length *= 0.5) {
            for (index_t i = 0; i < count; i++)
                s->trial[i] = c[i] + length * s->step[i];
            spread(s, s->trial);
            double ahead = cost_of(s, weight, stretch);
            if (isfinite(ahead) && ahead <= cost - 0.1 * length * decrement) {
                memcpy(c, s->trial, (size_t)count * sizeof(double));
                cost = ahead;
                break;
            }
        }
        spread(s, c);
        if (length < 1e-9)
            break;
    }
    return steps;
}

static double stretch_of(const search_t *s) {
    double share = largest_share(s);
    return share < INSIDE ? 1.0 : STRETCH * share;
}

static int improve(search_t *s, double begin, double gap, double *c) {
    spread(s, c);
    for (int spot = 0; spot < SPOTS; spot++)
        for (index_t e = 0; e < s->n; e++)
            if (!(s->y[spot][e] > 0.0))
                return PROFILE_NOT_FOUND;
    double stretch = stretch_of(s);
    bool is_free = !s->path->has_start && !s->path->has_end;
    if (stretch > 1.0 && is_free) {
        double slower = SLOWER / largest_share(s);
        for (index_t i = 0; i < s->n + 2; i++)
            c[i] *= slower;
        spread(s, c);
        stretch = 1.0;
    } else if (stretch > 1.0)
        begin = fmax(begin, FAR);
    double degree = (double)(SPOTS * s->n) * (1 + 2 * (s->bend_count + s->twist_count));
    double weight = begin * duration(s) / degree, near = DECREMENT;
    for (int steps = 0; steps <= MOST_STEPS;) {
        s->weight = weight;
        /* The jerk of axes is far from convex: its first centre takes longer to reach. */
        bool is_first = steps == 0 && begin >= 1.0 && s->path->axis_limits.m;
        int taken = centre(s, c, weight, stretch, near, is_first ? FIRST_STEPS : ROUND_STEPS);
        steps += taken;
        if (stretch > 1.0) {
            /* Limits that were moved out for the guess are moved in again as it improves; what is
             * given at an end may be close to them. */
            double share = largest_share(s), nearest = share < 1.0 ? 1.0 : NEAR * share;
            double next = fmax(fmin(stretch_of(s), fmax(1.0, 0.99 * stretch)), nearest);
            /* The next round would be the same again. */
            near = taken == 1 && next == stretch ? CLOSER : DECREMENT;
            stretch = next;
        } else if (weight * degree <= NEARLY * gap * duration(s))
            break;
        else
            weight = fmax(REDUCTION * weight, 0.99 * gap * duration(s) / degree);
    }
    spread(s, c);
    return stretch > 1.0 ? PROFILE_NOT_FOUND : PROFILE_FOUND;
}

static bool new_search(search_t *s, const profile_path_t *path, const rate_t *rates, int count) {
    int bends = 0, twists = 0;
    for (int r = 0; r < count; r++)
        bends += rates[r].order == 2, twists += rates[r].order == 3;
    *s = (search_t){.path = path, .n = path->widths.n, .h = path->widths.v};
    index_t row = s->n + 2;
    double *next = malloc((size_t)(rows_of_search(bends, twists) * row) * sizeof(double));
    s->memory = next;
    if (next == NULL)
        return false;
    double **rows[] = {&s->near, &s->far, &s->rise, &s->value, &s->slope, &s->y[0], &s->y[1],
                       &s->y[2], &s->d[0], &s->d[1], &s->d[2], &s->b, &s->diagonal, &s->beside,
                       &s->apart, &s->right, &s->step, &s->trial, &s->slack};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++, next += row)
        *rows[i] = next;
    for (int i = 0; i < 3; i++, next += 2 * row)
        s->g[i] = next, s->lg[i] = next + row;
    for (int i = 0; i < 6; i++, next += 2 * row)
        s->m[i] = next, s->lm[i] = next + row;
    for (int spot = 0; spot < SPOTS; spot++) {
        s->top[spot][0] = next, next += row;
        for (int k = 0; k < bends; k++)
            for (int i = 0; i < 3; i++, next += row)
                s->bends[spot][k][i] = next;
        for (int k = 0; k < twists; k++)
            for (int i = 0; i < 6; i++, next += row)
                s->twists[spot][k][i] = next;
    }
    double *duals = next;
    for (int spot = 0; spot < SPOTS; spot++)
        for (int i = 0; i < 2; i++) {
            s->top[spot][1 + i] = next, next += row;
            for (int k = 0; k < bends; k++, next += row)
                s->bends[spot][k][3 + i] = next;
            for (int k = 0; k < twists; k++, next += row)
                s->twists[spot][k][6 + i] = next;
        }
    /* No multiplier is known yet: the largest that the slack allows keeps the first step short. */
    for (double *one = duals; one < next; one++)
        *one = UNKNOWN;
    return true;
}

static void free_search(search_t *s) { free(s->memory); }

int find_profile(const profile_path_t *path, double begin, double gap, row_t coefficients,
                 matrix_t shares) {
    rate_t rates[MOST_RATES];
    search_t search;
    int count = put_limited(path, rates);
    if (!new_search(&search, path, rates, count))
        return OUT_OF_MEMORY;
    put_path(&search, rates, count);
    int found = improve(&search, begin, gap, coefficients.v);
    if (found == PROFILE_FOUND)
        put_shares(path, search.value, search.slope, shares);
    free_search(&search);
    return found;
}
