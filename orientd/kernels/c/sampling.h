/* Sample curves: what the kernels of this group offer. */
#ifndef ORIENTD_SAMPLING_H
#define ORIENTD_SAMPLING_H

#include "arrays.h"

/* Rows of the table of a curve of cubic factors, a column for each span: base quaternion, then
 * for each of three factors four Taylor coefficients of the half angle and the unit axis. */
enum { TABLE_ROWS = 25 };

/* cubic.c */

/* Return which span an instant inside the domain is in, the last one closed at its end. */
index_t span_of(double t, row_t breaks);

/* Write orientation, velocity and acceleration at instants in any order.
 *
 * times: instants, s, shape (n,).
 * breaks: ends of the spans, shape (S + 1,).
 * table: constants of the spans, shape (TABLE_ROWS, S).
 * slack: how far outside the domain an instant may be, s.
 * out: receives the samples, shape (10, n).
 *
 * Return the place of the first instant that is outside the domain, or -1 if none is. */
index_t sample_cubic(row_t times, row_t breaks, matrix_t table, double slack, matrix_t out);

/* cubic_table.c */

/* Write the table of a cubic spline with simple knots, as interpolate writes one.
 *
 * base: the quaternion before the product of each span, shape (S, 4).
 * increments: half-angle vectors, shape (S + 2, 3).
 * table: receives the constants of the spans, shape (TABLE_ROWS, S).
 *
 * Return 0, or OUT_OF_MEMORY. */
int put_table(row_t breaks, matrix_t base, matrix_t increments, matrix_t table);

/* product.c */

/* A cumulative product of m factors with S spans. */
typedef struct {
    row_t breaks;        /* ends of the spans, s, shape (S + 1,) */
    matrix_t base;       /* quaternions before the product of each span, shape (S, 4) */
    indices_t first;     /* the first increment of each span, shape (S,) */
    matrix_t increments; /* half-angle vectors, shape (n, 3) */
    tensor_t values;     /* Bernstein coefficients of the basis functions, shape (S, m, degree + 1) */
} product_t;

/* Write orientations at instants in any order, shape (n, 4); instants beyond the ends are taken to be
 * there.
 *
 * times: s, shape (n,). */
void sample_product(row_t times, product_t product, matrix_t out);

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
