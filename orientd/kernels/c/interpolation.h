/* Interpolate keyframes: the equations of cumulative B-splines, their solution, banded systems, and
 * the effort of a spline.  What the kernels of this group offer. */
#ifndef ORIENTD_INTERPOLATION_H
#define ORIENTD_INTERPOLATION_H

#include "arrays.h"

enum { NOT_FOUND = 0, FOUND = 1 };

/* c2.c */

/* Write the angle turned since the first keyframe, and return the least from one to the next.
 *
 * keyframes: unit quaternions, shape (n, 4).
 * chords: receives the angles, rad, shape (n,). */
double put_chords(matrix_t keyframes, row_t chords);

/* Write the twice differentiable cumulative cubic B-spline through keyframes.
 *
 * keyframes: unit quaternions, shape (n, 4), n >= 2.
 * is_aligned: whether they are to be taken with the signs they have.
 * times: of the keyframes, increasing, s, shape (n,).
 * given: angular velocity and acceleration at the first keyframe and at the last, body frame,
 *     shape (2, 2, 3).
 * start_known: how much of that is a condition at the first keyframe: 0 to 2.
 * end_known: the same at the last one; not 2 at both ends of two keyframes.
 * breaks: receives the ends of the spans, one more for each end with two conditions, shape
 *     (S + 1,), S = n - 1 + (start_known == 2) + (end_known == 2).
 * table: receives what the spline is sampled from, shape (TABLE_ROWS, S).
 * solved: receives the increments, shape (S + 2, 3).
 *
 * Return FOUND, NOT_FOUND if Newton's method does not converge from the Euclidean spline, or
 * OUT_OF_MEMORY. */
int interpolate_c2(matrix_t keyframes, bool is_aligned, row_t times, tensor_t given,
                   index_t start_known, index_t end_known, row_t breaks, matrix_t table,
                   matrix_t solved);

#endif
