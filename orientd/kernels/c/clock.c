/* Clocks of profiles; see clock.h. */
#include <math.h>

#include "clock.h"

/* c t^2 below which the series are exact to the last digit or two. */
#define SMALL 0.05
#define AT_REST 1e-13
enum { NEWTON_STEPS = 40 };

/* Return x, its rate and its change after a time on an element. */
static pace_t after(double rate, double change, double c, double t) {
    double z = c * t * t, s, k;  /* sinh(w t) / w and (cosh(w t) - 1) / w^2, where c = w^2 */
    if (fabs(z) < SMALL) {
        s = 1.0 + z * (1.0 / 6 + z * (1.0 / 120 + z * (1.0 / 5040 + z * (1.0 / 362880
            + z * (1.0 / 39916800)))));
        k = 1.0 + z * (1.0 / 12 + z * (1.0 / 360 + z * (1.0 / 20160 + z * (1.0 / 1814400
            + z * (1.0 / 239500800)))));
        s *= t, k *= 0.5 * t * t;
    } else {
        double w = sqrt(fabs(c)), half = c > 0.0 ? sinh(0.5 * w * t) : sin(0.5 * w * t);
        s = (c > 0.0 ? sinh(w * t) : sin(w * t)) / w;
        k = 2.0 * half * half / fabs(c);
    }
    double x = rate * s + change * k;
    return (pace_t){x, rate + change * s + c * rate * k, change + c * x};
}

/* How long an element takes, by the tangent of half the angle that its solution turns by. */
static double element_time(double width, double first, double last, double c) {
    double mean = width / (sqrt(first) + sqrt(last)), z = c * mean * mean;
    if (fabs(z) < 1e-3)
        return 2.0 * mean
             * (1.0 + z * (1.0 / 3 + z * (1.0 / 5 + z * (1.0 / 7 + z * (1.0 / 9 + z / 11)))));
    double w = sqrt(fabs(c));
    return 2.0 * (c > 0.0 ? atanh(fmin(w * mean, 1.0 - 1e-16)) : atan(w * mean)) / w;
}

void put_node_times(row_t places, row_t values, row_t slopes, row_t times) {
    times.v[0] = 0.0;
    for (index_t e = 0; e + 1 < places.n; e++) {
        double width = places.v[e + 1] - places.v[e];
        double c = 0.5 * (slopes.v[e + 1] - slopes.v[e]) / width;
        times.v[e + 1] = times.v[e] + element_time(width, values.v[e], values.v[e + 1], c);
    }
}

double leaving_gap(double length) { return length < 0.0 ? -0.5 * length : 0.2 * length; }

/* s and its first two derivatives by x where it leaves rest. */
static void leave(double x, double length, double to[3]) {
    double size = fabs(length), u = fmax(x / size, 0.0), root = sqrt(u);
    if (length < 0.0) {
        to[0] = size * u * u * u * (1.0 - 0.5 * u);
        to[1] = u * u * (3.0 - 2.0 * u);
        to[2] = 6.0 * u * (1.0 - u) / size;
        return;
    }
    to[0] = length * u * root * (1.0 - 0.2 * u);
    to[1] = root * (1.5 - 0.5 * u);
    /* At rest it is infinite; what it is multiplied by falls to zero faster. */
    to[2] = u > 1e-18 ? 0.75 * (1.0 - u) / (root * length) : 0.0;
}

static void parameter(double x, const double *leaves, double total, double to[3]) {
    double first = leaving_gap(leaves[0]), end = total - first - leaving_gap(leaves[1]);
    if (x < fabs(leaves[0]))
        leave(x, leaves[0], to);
    else if (total - x < fabs(leaves[1])) {
        leave(total - x, leaves[1], to);
        to[0] = end - to[0], to[2] = -to[2];
    } else
        to[0] = x - first, to[1] = 1.0, to[2] = 0.0;
}

/* How far x has come where the parameter has gone some way of a length from rest. */
static double left_rest(double way, double length) {
    double goal = way / fabs(length), u = length < 0.0 ? cbrt(goal) : cbrt(goal * goal);
    for (int i = 0; i < NEWTON_STEPS && u > 0.0; i++) {
        double root = sqrt(u);
        double step = length < 0.0
                    ? (u * u * u * (1.0 - 0.5 * u) - goal) / (u * u * (3.0 - 2.0 * u))
                    : (u * root * (1.0 - 0.2 * u) - goal) / (root * (1.5 - 0.5 * u));
        u -= step;
        if (fabs(step) <= 1e-16 * u)
            break;
    }
    return fabs(length) * u;
}

double coordinate_of(double value, const double leaves[2], double total) {
    double first = leaving_gap(leaves[0]), last = leaving_gap(leaves[1]);
    double ahead = total - first - last - value;
    if (value <= 0.0 || ahead <= 0.0)
        return value <= 0.0 ? 0.0 : total;
    if (value + first < fabs(leaves[0]))
        return left_rest(value, leaves[0]);
    return ahead + last < fabs(leaves[1]) ? total - left_rest(ahead, leaves[1]) : value + first;
}

void leave_rest(row_t places, row_t leaves, double total, matrix_t out) {
    for (index_t i = 0; i < places.n; i++) {
        double s[3];
        parameter(places.v[i], leaves.v, total, s);
        for (index_t k = 0; k < 3; k++)
            row_of(out, k)[i] = s[k];
    }
}

/* Return the element that an instant is in; most instants come in order. */
static index_t element_of(double t, row_t times, index_t near) {
    index_t last = times.n - 2;
    if (times.v[near] <= t && (near == last || t < times.v[near + 1]))
        return near;
    if (near < last && times.v[near + 1] <= t && (near + 1 == last || t < times.v[near + 2]))
        return near + 1;
    return piece_of(t, times);
}

void sample_clock(const clocked_t *clock, row_t instants, matrix_t out) {
    row_t times = clock->times, places = clock->places, values = clock->values;
    row_t slopes = clock->slopes, leaves = clock->leaves;
    double final = times.v[times.n - 1], total = places.v[places.n - 1];
    index_t e = 0;
    for (index_t i = 0; i < instants.n; i++) {
        double t = fmin(fmax(instants.v[i], 0.0), final), s[3];
        e = element_of(t, times, e);
        double c = 0.5 * (slopes.v[e + 1] - slopes.v[e]) / (places.v[e + 1] - places.v[e]);
        pace_t pace = after(sqrt(values.v[e]), 0.5 * slopes.v[e], c, t - times.v[e]);
        double x = fmin(places.v[e] + pace.s, places.v[e + 1]);
        if (t == final)
            x = total;
        parameter(x, leaves.v, total, s);
        row_of(out, 0)[i] = s[0];
        row_of(out, 1)[i] = s[1] * pace.rate;
        row_of(out, 2)[i] = s[2] * pace.rate * pace.rate + s[1] * pace.change;
    }
}

/* The parameter by time where it leaves rest. */
static pace_t left(pace_t x, double place, double length) {
    double s[3];
    /* At rest itself, but for rounding, where the second derivative by x is infinite. */
    leave(place < AT_REST * fabs(length) ? 0.0 : place, length, s);
    return (pace_t){s[0], s[1] * x.rate, s[2] * x.rate * x.rate + s[1] * x.change};
}

double put_paces(const clocked_t *clock, index_t e, double begin, double end,
                 const double *points, int count, pace_t *paces) {
    const double *x = clock->places.v, *y = clock->values.v, *slope = clock->slopes.v;
    const double *leaves = clock->leaves.v;
    double c = 0.5 * (slope[e + 1] - slope[e]) / (x[e + 1] - x[e]), total = x[clock->places.n - 1];
    double middle = 0.5 * (begin + end), half = 0.5 * (end - begin);
    double since = middle - clock->times.v[e], until = clock->times.v[e + 1] - middle;
    pace_t here = after(sqrt(y[e]), 0.5 * slope[e], c, since);
    if (x[e] + here.s < fabs(leaves[0])) {
        double base = left(here, x[e] + here.s, leaves[0]).s;
        for (int i = 0; i < count; i++) {
            pace_t pace = after(sqrt(y[e]), 0.5 * slope[e], c, since + half * points[i]);
            paces[i] = left(pace, x[e] + pace.s, leaves[0]);
            paces[i].s -= base;
        }
        return base;
    }
    /* Backwards from the end, so that what is left there has all its digits. */
    double ahead = total - x[e + 1], back = -0.5 * slope[e + 1];
    double last = ahead + after(sqrt(y[e + 1]), back, c, until).s;
    if (last < fabs(leaves[1])) {
        double base = left(here, last, leaves[1]).s;
        for (int i = 0; i < count; i++) {
            pace_t pace = after(sqrt(y[e + 1]), back, c, until - half * points[i]);
            pace = left(pace, ahead + pace.s, leaves[1]);
            paces[i] = (pace_t){base - pace.s, pace.rate, -pace.change};
        }
        return total - leaving_gap(leaves[0]) - leaving_gap(leaves[1]) - base;
    }
    for (int i = 0; i < count; i++)
        paces[i] = after(here.rate, here.change, c, half * points[i]);
    return x[e] + here.s - leaving_gap(leaves[0]);
}

double time_of(const clocked_t *clock, double value) {
    const double *x = clock->places.v, *y = clock->values.v, *slope = clock->slopes.v;
    const double *leaves = clock->leaves.v;
    index_t last = clock->places.n - 1, low = 0, high = last;
    double place = coordinate_of(value, leaves, x[last]);
    if (place <= 0.0 || place >= x[last])
        return clock->times.v[place <= 0.0 ? 0 : last];
    while (high - low > 1) {
        index_t middle = (low + high) / 2;
        if (x[middle] <= place)
            low = middle;
        else
            high = middle;
    }
    /* The part of an element up to there, as an element of its own. */
    double bend = (slope[high] - slope[low]) / (x[high] - x[low]), ahead = place - x[low];
    double square = y[low] + ahead * (slope[low] + 0.5 * ahead * bend);
    return clock->times.v[low] + element_time(ahead, y[low], fmax(square, 0.0), 0.5 * bend);
}
