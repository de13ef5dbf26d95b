/* Products of exponentials: what the kernels of this group offer. */
#ifndef ORIENTD_SAMPLING_H
#define ORIENTD_SAMPLING_H

#include "lanes.h"
#include "rotation.h"

/* product.c */

/* A cumulative product of m factors with S spans. */
typedef struct {
    row_t breaks;        /* ends of the spans, s, shape (S + 1,) */
    matrix_t base;       /* quaternions before the product of each span, shape (S, 4) */
    indices_t first;     /* the first increment of each span, shape (S,); or none: number s */
    matrix_t increments; /* half-angle vectors, shape (n, 3) */
    tensor_t values;     /* Bernstein coefficients of the basis functions, shape (S, m, degree + 1) */
} product_t;

/* Places that are worked off together, and what a product is there. */
enum { LANES = 16 };
typedef struct { double q[4][LANES], omega[3][LANES], alpha[3][LANES]; } motions_t;

/* Write orientation, angular velocity and acceleration at places u in [0, 1] of a span. */
void product_at(const product_t *product, index_t span, const double u[LANES], motions_t *found);

INLINE motion_t motion_of(const motions_t *of, index_t i) {
    return (motion_t){
        {of->q[0][i], of->q[1][i], of->q[2][i], of->q[3][i]},
        {of->omega[0][i], of->omega[1][i], of->omega[2][i]},
        {of->alpha[0][i], of->alpha[1][i], of->alpha[2][i]},
    };
}

/* A motion followed by a turn about a fixed axis, whose half angle has two derivatives. */
INLINE motion_t past_factor(motion_t before, vec_t axis, double angle, double rate, double bend) {
    double c, s;
    cosine_and_sine(angle, &c, &s);
    vec_t e = times(s, axis);
    motion_t after = {
        followed(before.q, c, e),
        turned_back(c, e, before.omega),
        turned_back(c, e, before.alpha),
    };
    join(&after.omega, &after.alpha, axis, 2.0 * rate, 2.0 * bend);
    return after;
}

/* basis.c */

/* Write the cumulative B-spline basis of an order on some spans, m = order - 1 functions on each.
 *
 * spans: the knot that each begins at, from order - 1 to the number of knots - order - 1 and
 *     not of length zero, shape (S,).
 * knots: the knot vector.
 * values: receives Bernstein coefficients of the functions that vary, shape (S, m, m + 1).
 * rates: receives those of their derivatives, shape (S, m, m); of no rows, neither they nor the
 *     curvatures are written.
 * curvatures: receives those of their second derivatives, shape (S, m, max(m - 1, 1)).
 *
 * Return 0, or OUT_OF_MEMORY. */
int fill_basis(indices_t spans, row_t knots, index_t order, tensor_t values, tensor_t rates,
               tensor_t curvatures);

#endif
