/* Orientations of a cumulative product of exponentials (Kim, Kim and Shin, 1995).
 *
 *     q(t) = q_0 exp(B_1(t) w_1) ... exp(B_m(t) w_m)
 *
 * The basis functions are held by their Bernstein coefficients.  Instants in one span are worked
 * off together, in one row of numbers for each quantity, a loop without a branch or a call for each
 * step.
 */
#include "lanes.h"
#include "rotation.h"
#include "sampling.h"

enum { LANES = 8, TILE = 64 };

typedef struct { double u[TILE], power[TILE], angle[TILE], q[4][TILE]; } tile_t;

/* Have the orientations of a tile followed by turns by a polynomial in Bernstein form. */
static void follow(tile_t *restrict tile, const double *restrict increment,
                   const double *restrict coefficients, index_t degree, index_t count) {
    vec_t w = vec_at(increment);
    double length = norm(w), inverse = length > 0.0 ? 1.0 / length : 0.0, binomial = 1.0;
    vec_t axis = times(inverse, w);
    for (index_t i = 0; i < count; i++)
        tile->power[i] = 1.0, tile->angle[i] = coefficients[0];
    for (index_t k = 1; k <= degree; k++) {
        binomial *= (double)(degree + 1 - k) / (double)k;
        double scaled = binomial * coefficients[k];
        INDEPENDENT
        for (index_t i = 0; i < count; i++) {
            tile->power[i] *= tile->u[i];
            tile->angle[i] = fused(scaled, tile->power[i], (1.0 - tile->u[i]) * tile->angle[i]);
        }
    }
    double (*restrict q)[TILE] = tile->q;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        double c, s;
        cosine_and_sine(length * tile->angle[i], &c, &s);
        quat_t turned = followed(quat(q[0][i], q[1][i], q[2][i], q[3][i]), c, times(s, axis));
        q[0][i] = turned.w, q[1][i] = turned.x, q[2][i] = turned.y, q[3][i] = turned.z;
    }
}

index_t span_of(double t, row_t breaks) {
    const double *low = breaks.v;
    for (index_t n = breaks.n - 1; n > 1;) {
        index_t half = n / 2;
        low = low[half] <= t ? low + half : low;
        n -= half;
    }
    return low - breaks.v;
}

void sample_product(row_t times, product_t product, matrix_t out) {
    row_t breaks = product.breaks;
    index_t factors = product.values.m, terms = product.values.k, i = 0;
    double last = breaks.v[breaks.n - 1];
    tile_t tile;
    while (i < times.n) {
        index_t span = span_of(times.v[i], breaks), count = 0;
        double start = breaks.v[span], end = breaks.v[span + 1];
        do {  /* as many as follow in the same span */
            double t = fmin(fmax(times.v[i + count], start), end);
            tile.u[count++] = (t - start) / (end - start);
        } while (count < TILE && i + count < times.n && start <= times.v[i + count]
                 && (times.v[i + count] < end || end == last));
        index_t padded = (count + LANES - 1) / LANES * LANES;
        for (index_t k = count; k < padded; k++)
            tile.u[k] = tile.u[count - 1];
        for (index_t c = 0; c < 4; c++)
            for (index_t k = 0; k < padded; k++)
                tile.q[c][k] = row_of(product.base, span)[c];
        for (index_t j = 0; j < factors; j++)
            follow(&tile, row_of(product.increments, product.first.v[span] + j),
                   product.values.v + (span * factors + j) * terms, terms - 1, padded);
        for (index_t k = 0; k < count; k++)
            put_quat(row_of(out, i + k), quat(tile.q[0][k], tile.q[1][k], tile.q[2][k],
                                              tile.q[3][k]));
        i += count;
    }
}
