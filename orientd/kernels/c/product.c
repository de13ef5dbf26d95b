/* Sample the cumulative product of any number of factors (Kim, Kim and Shin, 1995).
 *
 *     q(t) = q_0 exp(l_1 B_1(t) a_1) ... exp(l_m B_m(t) a_m)
 *
 * The basis functions are held by their Bernstein coefficients.  Instants in one span are worked
 * off together, in one row of numbers for each quantity, a loop without a branch or a call for each
 * step.
 */
#include <stdlib.h>

#include "lanes.h"
#include "rotation.h"
#include "sampling.h"

enum { LANES = 8, TILE = 64 };

/* Rows of instants: the parameter in the span, the motion so far, the half angle of a factor and
 * its two derivatives. */
typedef struct {
    double u[TILE], motion[10][TILE], angle[TILE], rate[TILE], curvature[TILE];
} tile_t;

typedef double weights_t[TILE];  /* a row for each Bernstein polynomial of a degree */

/* Replace the Bernstein polynomials of one degree by those of the next, degree. */
static void raise_degree(const double *restrict u, weights_t *restrict w, index_t degree,
                         index_t count) {
    INDEPENDENT
    for (index_t i = 0; i < count; i++)
        w[degree][i] = u[i] * w[degree - 1][i];
    for (index_t j = degree - 1; j > 0; j--) {
        INDEPENDENT
        for (index_t i = 0; i < count; i++)
            w[j][i] = fused(u[i], w[j - 1][i], (1.0 - u[i]) * w[j][i]);
    }
    INDEPENDENT
    for (index_t i = 0; i < count; i++)
        w[0][i] *= 1.0 - u[i];
}

static void copy_rows(const weights_t *restrict from, weights_t *restrict to, index_t rows,
                      index_t count) {
    for (index_t row = 0; row < rows; row++)
        for (index_t i = 0; i < count; i++)
            to[row][i] = from[row][i];
}

/* Write the Bernstein polynomials of degree m - 2, at least 0, then those of m - 1 and of m. */
static void put_weights(const double *u, weights_t *low, index_t m, index_t count) {
    weights_t *middle = low + most(m - 1, 1), *high = middle + m;
    for (index_t i = 0; i < count; i++)
        low[0][i] = 1.0;
    for (index_t degree = 1; degree < m - 1; degree++)
        raise_degree(u, low, degree, count);
    copy_rows(low, middle, most(m - 1, 1), count);
    if (m > 1)
        raise_degree(u, middle, m - 1, count);
    copy_rows(middle, high, m, count);
    raise_degree(u, high, m, count);
}

/* Write the sum of some polynomials, each times its coefficient and a scale. */
static void weigh(const weights_t *restrict w, const double *coefficients, index_t rows,
                  double scale, double *restrict sum, index_t count) {
    for (index_t i = 0; i < count; i++)
        sum[i] = 0.0;
    for (index_t row = 0; row < rows; row++) {
        double share = scale * coefficients[row];
        INDEPENDENT
        for (index_t i = 0; i < count; i++)
            sum[i] = fused(share, w[row][i], sum[i]);
    }
}

/* Have the motions of a tile followed by turns about one axis. */
static void follow(tile_t *restrict tile, vec_t axis, index_t count) {
    double (*restrict v)[TILE] = tile->motion;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        double c, s;
        cosine_and_sine(tile->angle[i], &c, &s);
        vec_t e = times(s, axis);
        quat_t q = followed(quat(v[0][i], v[1][i], v[2][i], v[3][i]), c, e);
        vec_t omega = turned_back(c, e, vec(v[4][i], v[5][i], v[6][i]));
        vec_t alpha = turned_back(c, e, vec(v[7][i], v[8][i], v[9][i]));
        join(&omega, &alpha, axis, 2.0 * tile->rate[i], 2.0 * tile->curvature[i]);
        v[0][i] = q.w, v[1][i] = q.x, v[2][i] = q.y, v[3][i] = q.z;
        v[4][i] = omega.x, v[5][i] = omega.y, v[6][i] = omega.z;
        v[7][i] = alpha.x, v[8][i] = alpha.y, v[9][i] = alpha.z;
    }
}

index_t sample_product(row_t times, row_t breaks, matrix_t base, tensor_t axes, matrix_t lengths,
                       tensor_t values, tensor_t rates, tensor_t curvatures, double slack,
                       matrix_t out) {
    index_t spans = breaks.n - 1, m = lengths.n, bends = curvatures.k;
    double first = breaks.v[0], last = breaks.v[spans];
    tile_t tile;
    weights_t *low = malloc((size_t)(most(m - 1, 1) + m + m + 1) * sizeof *low);
    if (low == NULL)
        return OUT_OF_MEMORY;
    weights_t *middle = low + most(m - 1, 1), *high = middle + m;
    index_t i = 0;
    while (i < times.n) {
        double t = times.v[i];
        if (!(first - slack <= t && t <= last + slack))
            break;
        t = fmin(fmax(t, first), last);
        index_t span = span_of(t, breaks), count = 0;
        double start = breaks.v[span], end = breaks.v[span + 1];
        do {  /* as many as follow in the same span */
            tile.u[count++] = (t - start) / (end - start);
            if (count == TILE || i + count == times.n)
                break;
            t = times.v[i + count];
        } while (start <= t && t < end);
        index_t padded = (count + LANES - 1) / LANES * LANES;
        for (index_t k = count; k < padded; k++)
            tile.u[k] = tile.u[count - 1];
        put_weights(tile.u, low, m, padded);
        for (index_t row = 0; row < 10; row++)
            for (index_t k = 0; k < padded; k++)
                tile.motion[row][k] = row < 4 ? row_of(base, row)[span] : 0.0;
        for (index_t j = 0; j < m; j++) {
            double length = row_of(lengths, j)[span];
            weigh(high, values.v + (span * m + j) * (m + 1), m + 1, length, tile.angle, padded);
            weigh(middle, rates.v + (span * m + j) * m, m, length, tile.rate, padded);
            weigh(low, curvatures.v + (span * m + j) * bends, bends, length, tile.curvature,
                  padded);
            const double *axis = axes.v + 3 * j * spans + span;
            follow(&tile, vec(axis[0], axis[spans], axis[2 * spans]), padded);
        }
        for (index_t row = 0; row < 10; row++)
            for (index_t k = 0; k < count; k++)
                row_of(out, row)[i + k] = tile.motion[row][k];
        i += count;
    }
    free(low);
    return i < times.n ? i : -1;
}
