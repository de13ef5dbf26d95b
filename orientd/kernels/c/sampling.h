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

/* product.c */

/* The same of a product of any number of factors. */
index_t sample_product(row_t times, row_t breaks, matrix_t base, tensor_t axes, matrix_t lengths,
                       tensor_t values, tensor_t rates, tensor_t curvatures, double slack,
                       matrix_t out);

#endif
