/* Cumulative products of exponentials (Kim, Kim and Shin, 1995).
 *
 *     q(t) = q_0 exp(B_1(t) w_1) ... exp(B_m(t) w_m)
 *
 * The basis functions are held by their Bernstein coefficients.  Places in one span are worked off
 * together, in one row of numbers for each quantity, a loop without a branch or a call for each
 * factor.
 */
#include "sampling.h"

/* Write a polynomial in Bernstein form, or its first or second derivative by u. */
INLINE void put_bernstein(const double *c, index_t degree, int order, const double *restrict u,
                          double *restrict out) {
    double power[LANES], binomial = 1.0, scale = 1.0;
    index_t top = degree - order;
    for (int k = 0; k < order; k++)
        scale *= (double)(degree - k);
    for (index_t i = 0; i < LANES; i++)
        power[i] = 1.0, out[i] = 0.0;
    for (index_t k = 0; k <= top; k++) {
        double here = order == 0 ? c[k] : order == 1 ? c[k + 1] - c[k]
                    : c[k + 2] - c[k + 1] - (c[k + 1] - c[k]);
        double scaled = scale * binomial * here;
        INDEPENDENT
        for (index_t i = 0; i < LANES; i++) {
            out[i] = fused(scaled, power[i], (1.0 - u[i]) * out[i]);
            power[i] *= u[i];
        }
        binomial *= (double)(top - k) / (double)(k + 1);
    }
}

INLINE void put_product(const product_t *product, index_t span, index_t degree,
                        const double *restrict u, motions_t *restrict to) {
    index_t factors = product->values.m, terms = product->values.k;
    index_t first = product->first.n ? product->first.v[span] : span;
    double inverse = 1.0 / (product->breaks.v[span + 1] - product->breaks.v[span]);
    const double *base = row_of(product->base, span);
    for (index_t i = 0; i < LANES; i++) {
        for (index_t k = 0; k < 4; k++)
            to->q[k][i] = base[k];
        for (index_t k = 0; k < 3; k++)
            to->omega[k][i] = to->alpha[k][i] = 0.0;
    }
    for (index_t j = 0; j < factors; j++) {
        vec_t w = vec_at(row_of(product->increments, first + j));
        double length = norm(w), angle[LANES], rate[LANES], bend[LANES];
        vec_t axis = times(length > 0.0 ? 1.0 / length : 0.0, w);
        const double *c = product->values.v + (span * factors + j) * terms;
        put_bernstein(c, degree, 0, u, angle);
        put_bernstein(c, degree, 1, u, rate);
        put_bernstein(c, degree, 2, u, bend);
        INDEPENDENT
        for (index_t i = 0; i < LANES; i++) {
            motion_t here = past_factor(motion_of(to, i), axis, length * angle[i],
                                        length * inverse * rate[i],
                                        length * inverse * inverse * bend[i]);
            to->q[0][i] = here.q.w, to->q[1][i] = here.q.x;
            to->q[2][i] = here.q.y, to->q[3][i] = here.q.z;
            to->omega[0][i] = here.omega.x, to->omega[1][i] = here.omega.y;
            to->omega[2][i] = here.omega.z, to->alpha[0][i] = here.alpha.x;
            to->alpha[1][i] = here.alpha.y, to->alpha[2][i] = here.alpha.z;
        }
    }
}

void product_at(const product_t *product, index_t span, const double u[LANES], motions_t *found) {
    index_t degree = product->values.k - 1;
    if (degree == 3)
        put_product(product, span, 3, u, found);
    else
        put_product(product, span, degree, u, found);
}
