/* Shares of its limits that a profile uses, checked at five places in every element. */
#include <math.h>

#include "profile.h"

enum { PLACES = 5 };

static int add_rates(const matrix_t *first, const matrix_t *second, double norm,
                     const double *axes, int order, rate_t *rates) {
    int count = 0;
    /* A norm that is only what the axes imply is never in the way. */
    bool is_implied = axes != NULL
                   && norm >= (1.0 - 1e-12) * sqrt(axes[0] * axes[0] + axes[1] * axes[1]
                                                   + axes[2] * axes[2]);
    if (norm < INFINITY && !is_implied)
        rates[count++] = (rate_t){first->v, second->v, ALL_AXES, norm, order, -1};
    for (index_t k = 0; axes != NULL && k < 3; k++)
        if (axes[k] < INFINITY)
            rates[count++] = (rate_t){first->v, second->v, k, axes[k], order, -1};
    return count;
}

int put_limited(const profile_path_t *path, rate_t rates[MOST_RATES]) {
    int count = 0;
    for (int order = 1; order <= 3; order++) {
        const double *limits = row_of(path->limits, order - 1);
        count += add_rates(&path->first, &path->second, limits[0], limits + 1, order,
                           rates + count);
        if (order < 3 && path->move_first.n)
            count += add_rates(&path->move_first, &path->move_second,
                               path->move_limits.v[order - 1], NULL, order, rates + count);
        /* The angle of an axis is a scalar, one column of a group of three. */
        index_t group = 3 * (2 * path->widths.n + 1);
        for (index_t k = 0; k < path->axis_limits.m && order <= path->axis_limits.n; k++) {
            double limit = row_of(path->axis_limits, order - 1)[k];
            if (limit < INFINITY)
                rates[count++] = (rate_t){path->axis_first + k / 3 * group,
                                          path->axis_second + k / 3 * group, k % 3, limit, order, k};
        }
    }
    return count;
}

/* Square of a component or of all of them, as a share of the limit. */
INLINE double square_of(const rate_t *rate, const double v[3]) {
    double square = rate->axis == ALL_AXES ? v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
                                           : v[rate->axis] * v[rate->axis];
    return square / (rate->limit * rate->limit);
}

/* A quadratic through three places, 0, 1/2 and 1: its value, and its slope by the share. */
INLINE double between(double a, double b, double c, double u) {
    return a + u * ((4.0 * b - 3.0 * a - c) + u * (2.0 * (a + c) - 4.0 * b));
}
INLINE double slope_between(double a, double b, double c, double u) {
    return (4.0 * b - 3.0 * a - c) + u * (4.0 * (a + c) - 8.0 * b);
}

/* The largest share that a profile has of a rate in an element. */
static double share_in(const profile_path_t *path, const rate_t *rate, index_t e,
                       const double *values, const double *slopes) {
    double h = path->widths.v[e], bend = (slopes[e + 1] - slopes[e]) / h, most = 0.0;
    const double *p = rate->first + 6 * e, *s = rate->second + 6 * e;
    for (int place = 0; place < PLACES; place++) {
        double u = place / (PLACES - 1.0), x = u * h, v[3];
        double y = values[e] + x * (slopes[e] + 0.5 * x * bend);
        double slope = slopes[e] + x * bend;
        y = larger(y, 0.0);
        for (index_t k = 0; k < 3; k++) {
            double one = between(p[k], p[k + 3], p[k + 6], u);
            double two = between(s[k], s[k + 3], s[k + 6], u);
            double three = slope_between(s[k], s[k + 3], s[k + 6], u) / h;
            v[k] = rate->order == 1   ? one
                   : rate->order == 2 ? two * y + 0.5 * one * slope
                                      : three * y + 1.5 * two * slope + 0.5 * one * bend;
        }
        most = larger(square_of(rate, v) * (rate->order == 2 ? 1.0 : y), most);
    }
    return sqrt(most);
}

void put_shares(const profile_path_t *path, const double *values, const double *slopes,
                matrix_t shares) {
    rate_t rates[MOST_RATES];
    int count = put_limited(path, rates);
    for (index_t i = 0; i < 3 * shares.m; i++)
        shares.v[i] = 0.0;
    for (int r = 0; r < count; r++) {
        double *largest = row_of(shares, rates[r].order - 1);
        for (index_t e = 0; e < path->widths.n; e++)
            largest[e] = larger(share_in(path, &rates[r], e, values, slopes), largest[e]);
    }
}

bool free_axes(const profile_path_t *path, const double *values, const double *slopes,
               double share) {
    rate_t rates[MOST_RATES];
    int count = put_limited(path, rates), kept = 0;
    for (int r = 0; r < count; r++) {
        double most = 0.0, *axes = row_of(path->axis_limits, rates[r].order - 1);
        if (rates[r].at < 0)
            continue;
        for (index_t e = 0; e < path->widths.n; e++)
            most = larger(share_in(path, &rates[r], e, values, slopes), most);
        if (most < share)
            axes[rates[r].at] = INFINITY;
        else
            kept++;
    }
    return kept == 0;
}
