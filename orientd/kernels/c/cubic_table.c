/* The table that a cubic cumulative B-spline with simple knots is sampled from. */
#include <stdlib.h>

#include "rotation.h"
#include "sampling.h"

enum { PAD = 2 };

/* The cumulative cubic basis where a span begins: of each of its three functions the value, the
 * derivative, half the second one and a sixth of the third one, which is constant on the span.
 *
 * The knots are simple, but for both ends, so that the recursion of de Boor has a closed form in the
 * widths of the span and of two neighbours on either side, those beyond the ends being zero. */
typedef struct { double value[3], rate[3], half_curvature[3], sixth_change[3]; } basis_t;

INLINE basis_t basis_at(double hh, double h, double here, double p, double pp) {
    double before = h + here, after = here + p;
    double first = 1.0 / (hh + before), middle = 1.0 / (before + p), third = 1.0 / (after + pp);
    double in_before = 1.0 / before, in_after = 1.0 / after, inverse = 1.0 / here;
    basis_t b;
    b.value[0] = 1.0 - here * in_before * (here * first);
    b.value[1] = h * in_before * (h * middle);
    b.value[2] = 0.0;
    b.rate[0] = 3.0 * first * (here * in_before);
    b.rate[1] = 3.0 * middle * (h * in_before);
    b.rate[2] = 0.0;
    b.half_curvature[0] = -3.0 * first * in_before;
    b.half_curvature[1] = 3.0 * middle * in_before;
    b.half_curvature[2] = 0.0;
    b.sixth_change[0] = first * in_before * inverse;
    b.sixth_change[1] = -middle * (in_before + in_after) * inverse;
    b.sixth_change[2] = third * in_after * inverse;
    return b;
}

/* Increments as lengths and unit axes, a row for each, and widths of spans with zeros around. */
typedef struct { double *restrict length, *restrict x, *restrict y, *restrict z, *restrict h; } parts_t;

/* The factors of each span: coefficients of the half angle, and the axis. */
static void put_factors(parts_t w, double *restrict out, index_t spans) {
    const double *restrict h = w.h;
    INDEPENDENT
    for (index_t s = 0; s < spans; s++) {
        basis_t b = basis_at(h[s - 2], h[s - 1], h[s], h[s + 1], h[s + 2]);
        for (index_t f = 0; f < 3; f++) {
            double length = w.length[s + f];
            double *to = out + (4 + 7 * f) * spans + s;
            to[0] = length * b.value[f];
            to[spans] = length * b.rate[f];
            to[2 * spans] = length * b.half_curvature[f];
            to[3 * spans] = length * b.sixth_change[f];
            to[4 * spans] = w.x[s + f], to[5 * spans] = w.y[s + f], to[6 * spans] = w.z[s + f];
        }
    }
}

int put_table(row_t breaks, matrix_t base, matrix_t increments, matrix_t table) {
    index_t spans = table.m, count = spans + 2;
    double *memory = malloc(sizeof(double) * (size_t)(4 * count + spans + 2 * PAD));
    if (!memory)
        return OUT_OF_MEMORY;
    parts_t w = {memory, memory + count, memory + 2 * count, memory + 3 * count,
                 memory + 4 * count + PAD};
    for (index_t k = 0; k < PAD; k++)
        w.h[-1 - k] = w.h[spans + k] = 0.0;
    for (index_t s = 0; s < spans; s++) {
        w.h[s] = breaks.v[s + 1] - breaks.v[s];
        for (index_t k = 0; k < 4; k++)
            table.v[k * spans + s] = base.v[4 * s + k];
    }
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        vec_t v = vec_at(increments.v + 3 * i);
        double length = norm(v), inverse = length > 0.0 ? 1.0 / length : 1.0;
        w.length[i] = length;
        w.x[i] = inverse * v.x, w.y[i] = inverse * v.y, w.z[i] = inverse * v.z;
    }
    put_factors(w, table.v, spans);
    free(memory);
    return 0;
}
