/* Sample the cumulative product of up to three cubic factors (Kim, Kim and Shin, 1995).
 *
 *     q(t) = q_0 exp(x_1(t) a_1) exp(x_2(t) a_2) exp(x_3(t) a_3)
 *
 * Instants are grouped into runs inside one span.  A run goes through one loop whose constants are
 * scalars and whose results go straight to contiguous rows.  Instants that are alone in their
 * span, as unsorted ones are, are collected in a tile with the constants of each.  No loop
 * branches or calls, so the compiler turns them into vector instructions.
 */
#include <string.h>

#include "lanes.h"
#include "rotation.h"
#include "sampling.h"

enum {
    LANES = 8,   /* the shorter runs are padded to so many */
    ALONE = 2,   /* runs up to so many instants go into a tile */
    TILE = 64,
    STRIDE = 64, /* instants that are looked at together for whether they are in a span */
    SAMPLE = 10, /* numbers of a sample: orientation, velocity, acceleration */
};

/* A factor on a span: Taylor coefficients of its half angle, the factorials divided out, and its
 * unit axis. */
typedef struct { double a0, a1, a2, a3; vec_t axis; } factor_t;

INLINE void turn(double t, factor_t f, double *c, vec_t *e, double *rate, double *curvature) {
    double s;
    cosine_and_sine(fused(t, fused(t, fused(t, f.a3, f.a2), f.a1), f.a0), c, &s);
    *e = times(s, f.axis);
    *rate = 2.0 * fused(t, fused(t, 3.0 * f.a3, 2.0 * f.a2), f.a1);
    *curvature = fused(t, 12.0 * f.a3, 4.0 * f.a2);
}

INLINE motion_t sampled(double t, quat_t base, factor_t f, factor_t g, factor_t h) {
    double c, rate, curvature, next_rate, next_curvature;
    vec_t e;
    motion_t out;
    /* The first factor's velocity and acceleration have its axis, which is turned for both. */
    turn(t, f, &c, &e, &rate, &curvature);
    out.q = followed(base, c, e);
    turn(t, g, &c, &e, &next_rate, &next_curvature);
    out.q = followed(out.q, c, e);
    vec_t axis = turned_back(c, e, f.axis);
    out.omega = times(rate, axis);
    out.alpha = times(curvature, axis);
    join(&out.omega, &out.alpha, g.axis, next_rate, next_curvature);
    turn(t, h, &c, &e, &rate, &curvature);
    out.q = followed(out.q, c, e);
    out.omega = turned_back(c, e, out.omega);
    out.alpha = turned_back(c, e, out.alpha);
    join(&out.omega, &out.alpha, h.axis, rate, curvature);
    return out;
}

INLINE factor_t factor_at(const double *v, index_t step) {
    return (factor_t){v[0], v[step], v[2 * step], v[3 * step],
                      {v[4 * step], v[5 * step], v[6 * step]}};
}

/* Write samples of instants inside one span to ten rows that are stride numbers apart. */
INLINE void fill_span(const double *restrict times, index_t count, double start,
                             const double *constants, index_t spans,
                             double *restrict out, index_t stride) {
    quat_t base = quat(constants[0], constants[spans], constants[2 * spans], constants[3 * spans]);
    factor_t f = factor_at(constants + 4 * spans, spans);
    factor_t g = factor_at(constants + 11 * spans, spans);
    factor_t h = factor_at(constants + 18 * spans, spans);
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        motion_t s = sampled(times[i] - start, base, f, g, h);
        out[i] = s.q.w, out[stride + i] = s.q.x;
        out[2 * stride + i] = s.q.y, out[3 * stride + i] = s.q.z;
        out[4 * stride + i] = s.omega.x, out[5 * stride + i] = s.omega.y;
        out[6 * stride + i] = s.omega.z, out[7 * stride + i] = s.alpha.x;
        out[8 * stride + i] = s.alpha.y, out[9 * stride + i] = s.alpha.z;
    }
}

/* Instants of spans of their own: rows of times since the span began, constants and results. */
typedef struct { double v[1 + TABLE_ROWS + SAMPLE][TILE]; index_t held; } tile_t;

static void fill_tile(tile_t *tile) {
    double (*restrict v)[TILE] = tile->v;
    INDEPENDENT
    for (index_t i = 0; i < TILE; i++) {
        quat_t base = quat(v[1][i], v[2][i], v[3][i], v[4][i]);
        motion_t s = sampled(v[0][i], base, factor_at(&v[5][i], TILE), factor_at(&v[12][i], TILE),
                             factor_at(&v[19][i], TILE));
        v[26][i] = s.q.w, v[27][i] = s.q.x, v[28][i] = s.q.y, v[29][i] = s.q.z;
        v[30][i] = s.omega.x, v[31][i] = s.omega.y, v[32][i] = s.omega.z;
        v[33][i] = s.alpha.x, v[34][i] = s.alpha.y, v[35][i] = s.alpha.z;
    }
}

/* Work off a tile, the instants before end, and empty it. */
static void unload(tile_t *tile, index_t end, matrix_t out) {
    if (!tile->held)
        return;
    fill_tile(tile);
    for (index_t row = 0; row < SAMPLE; row++) {
        double *to = row_of(out, row) + end - tile->held;
        for (index_t i = 0; i < tile->held; i++)
            to[i] = tile->v[1 + TABLE_ROWS + row][i];
    }
    tile->held = 0;
}

INLINE void load(tile_t *tile, double elapsed, const double *constants, index_t spans) {
    index_t place = tile->held++;
    tile->v[0][place] = elapsed;
    for (index_t row = 0; row < TABLE_ROWS; row++)
        tile->v[1 + row][place] = constants[row * spans];
}

/* Write samples of fewer instants than a vector has lanes. */
static void fill_short(const double *times, index_t count, double start, const double *constants,
                       index_t spans, double *out, index_t stride) {
    double padded[LANES], samples[SAMPLE * LANES];
    for (index_t i = 0; i < LANES; i++)
        padded[i] = times[least(i, count - 1)];
    fill_span(padded, LANES, start, constants, spans, samples, LANES);
    for (index_t row = 0; row < SAMPLE; row++)
        for (index_t i = 0; i < count; i++)
            out[row * stride + i] = samples[row * LANES + i];
}

/* How many of the next STRIDE instants are in a span, in a loop without a way out. */
INLINE index_t inside(const double *times, double start, double end) {
    index_t found = 0;
    for (index_t i = 0; i < STRIDE; i++)
        found += (times[i] >= start) & (times[i] < end);
    return found;
}

/* How many instants are in a span from the first one on, which is taken to be. */
INLINE index_t run_length(const double *times, index_t count, double start, double end) {
    index_t stop = 1, few = least(count, LANES);
    while (stop < few && start <= times[stop] && times[stop] < end)
        stop++;
    if (stop < LANES)
        return stop;
    while (stop + STRIDE <= count && inside(times + stop, start, end) == STRIDE)
        stop += STRIDE;
    while (stop < count && start <= times[stop] && times[stop] < end)
        stop++;
    return stop;
}

index_t sample_cubic(row_t times, row_t breaks, matrix_t table, double slack, matrix_t out) {
    index_t spans = table.m, span = 0;
    double first = breaks.v[0], last = breaks.v[breaks.n - 1];
    tile_t tile;
    if (times.n > ALONE)  /* places that are never loaded are worked off like the others */
        memset(&tile, 0, sizeof tile);
    tile.held = 0;
    for (index_t i = 0; i < times.n;) {
        double t = times.v[i], start = breaks.v[span], end = breaks.v[span + 1];
        if (!(start <= t && t < end)) {
            if (!(first - slack <= t && t <= last + slack))
                return i;
            t = fmin(fmax(t, first), last);
            if (span + 2 < breaks.n && breaks.v[span + 1] <= t && t < breaks.v[span + 2])
                span++;
            else
                span = span_of(t, breaks);
            start = breaks.v[span], end = breaks.v[span + 1];
        }
        const double *constants = table.v + span;
        index_t stop = i + run_length(times.v + i, times.n - i, start, end);
        if (t != times.v[i]) {
            unload(&tile, i, out);
            fill_short(&t, 1, start, constants, spans, out.v + i, out.m);
            i++;
        } else if (stop - i > ALONE || times.n <= ALONE) {
            unload(&tile, i, out);
            index_t whole = (stop - i) / LANES * LANES;
            fill_span(times.v + i, whole, start, constants, spans, out.v + i, out.m);
            i += whole;
            /* What is written beyond the end of the span is written again by those that follow. */
            if (i < stop && i + LANES <= times.n)
                fill_span(times.v + i, LANES, start, constants, spans, out.v + i, out.m);
            else if (i < stop)
                fill_short(times.v + i, stop - i, start, constants, spans, out.v + i, out.m);
            i = stop;
        } else {
            for (; i < stop; i++) {
                load(&tile, times.v[i] - start, constants, spans);
                if (tile.held == TILE)
                    unload(&tile, i + 1, out);
            }
        }
    }
    unload(&tile, times.n, out);
    return -1;
}
