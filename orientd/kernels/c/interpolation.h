/* Interpolate keyframes: the equations of cumulative cubic B-splines and their solution, banded
 * systems, and the effort of a spline.  What the kernels of this group offer. */
#ifndef ORIENTD_INTERPOLATION_H
#define ORIENTD_INTERPOLATION_H

#include "arrays.h"

enum { NOT_FOUND = 0, FOUND = 1 };

/* One equation for each of N intervals between keyframes, in as many unknown increments, half-angle
 * vectors.  Between two neighbouring keyframes the product telescopes to four factors,
 *
 *     exp(-B_i w_i) exp((1 - A_i) w_{i-1}) exp(A_{i+1} w_i) exp(B_{i+1} w_{i+1}),
 *
 * to be the turn from the one to the other.  A_i and B_i are how much of the two factors under way
 * at keyframe i has been turned there.  Increments are never taken from logarithms of control
 * quaternions, so they may pass pi and keep their winding: it is the cut of the logarithm, not the
 * equations, that stops a solver with principal logarithms.
 *
 * The first row's w_{-1} and the last one's w_N are known, or multiples of their neighbours.  Where
 * two increments are known at an end they are taken off the turn; the shares of the keyframe there
 * are such (1, 0) that no others occur. */
typedef struct {
    matrix_t steps;        /* half-angle vectors from keyframe to keyframe, shape (N, 3) */
    matrix_t begun;        /* A and B, shape (N + 1, 2) */
    matrix_t heads, tails; /* known at the start and at the end, the outermost first, (0..2, 3) */
    double start_ratio;    /* with no heads w_{-1} is this multiple of w_0 */
    double end_ratio;      /* the same of w_N and w_{N-1} */
} equations_t;

/* increments.c */

/* Write the half-angle vectors by which some rows miss their steps.
 *
 * scale: of the steps and of what is known at the ends.
 * unknown: the increments, shape (N, 3).
 * rows: increasing numbers of rows, shape (n,).
 * errors: receives the errors, shape (n, 3).
 *
 * Return FOUND or OUT_OF_MEMORY. */
int keyframe_errors(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                    matrix_t errors);

/* Write a Newton step of some rows, the other unknowns staying as they are.
 *
 * errors: what the step is to cancel, shape (n, 3); of no rows, the errors themselves.
 * correction: receives the step, shape (n, 3); not finite where the system is singular.
 *
 * Return FOUND or OUT_OF_MEMORY. */
int keyframe_step(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                  matrix_t errors, matrix_t correction);

/* Write the increments of the spline in Euclidean space with the same steps, shape (N, 3).
 *
 * Return FOUND or OUT_OF_MEMORY. */
int euclidean_increments(const equations_t *equations, matrix_t unknown);

/* Write the increments that Newton's method finds from there, shape (N, 3).
 *
 * first: the row to begin with; what stands before it has been found, and hardly changes.
 *
 * Return how many have been found, fewer than N where it does not converge quickly, or
 * OUT_OF_MEMORY, which is below zero. */
index_t find_increments(const equations_t *equations, matrix_t unknown, index_t first);

/* c2.c */

/* Return whether the norms of all quaternions, shape (n, 4), are one within a tolerance. */
bool are_unit(matrix_t keyframes, double tolerance);

/* Write the half-angle vectors from each keyframe to the next, all digits of small ones.
 *
 * keyframes: unit quaternions with the signs wanted, shape (n, 4).
 * steps: receives the vectors, of length up to pi, shape (n - 1, 3). */
void put_steps(matrix_t keyframes, matrix_t steps);

/* Write the equations of the spline of interpolate_c2, but for the steps.
 *
 * begun: receives shares, shape (n, 2).
 * known: receives what is known at the start and at the end, the outermost first, shape (2, 2, 3).
 * ratios: receives the two ratios, shape (2,).
 * The others are as for interpolate_c2. */
void put_equations(row_t times, tensor_t given, index_t start_known, index_t end_known,
                   row_t breaks, matrix_t begun, tensor_t known, row_t ratios);

/* Write what the spline is sampled from.
 *
 * keyframes: with the signs wanted, shape (n, 4).
 * with_start: whether the first interval has one more break.
 * breaks, solved, table: as for interpolate_c2.
 *
 * Return FOUND or OUT_OF_MEMORY. */
int put_table(matrix_t keyframes, bool with_start, row_t breaks, matrix_t solved, matrix_t table);

/* Write the twice differentiable cumulative cubic B-spline through keyframes.
 *
 * keyframes: unit quaternions with the signs wanted, shape (n, 4), n >= 2.
 * times: of the keyframes, increasing, s, shape (n,).
 * given: angular velocity and acceleration at the first keyframe and at the last, body frame,
 *     shape (2, 2, 3).
 * start_known: how much of that is a condition at the first keyframe: 0 to 2.
 * end_known: the same at the last one.
 * breaks: receives the ends of the spans, one more for each end with two conditions, shape
 *     (S + 1,), S = n - 1 + (start_known == 2) + (end_known == 2).
 * table: receives what the spline is sampled from, shape (TABLE_ROWS, S).
 * solved: receives the increments, shape (S + 2, 3).
 *
 * Return as find_increments; where not all are found, only the unknown ones of them are written. */
index_t interpolate_c2(matrix_t keyframes, row_t times, tensor_t given, index_t start_known,
                       index_t end_known, row_t breaks, matrix_t table, matrix_t solved);

/* banded.c */

/* Replace right sides by the solutions of a banded system, by elimination with row exchanges.
 *
 * band: the diagonals from the uppermost to the lowest, an entry in its column, shape
 *     (lower + upper + 1, n).
 * right: right sides, shape (n, k).
 *
 * Return FOUND, NOT_FOUND if the matrix is singular or not finite, or OUT_OF_MEMORY. */
int solve_banded(matrix_t band, index_t lower, index_t upper, matrix_t right);

/* effort.c */

enum { MOST_FACTORS = 8 };

/* Write derivatives of the effort of a spline and of its keyframe equations.
 *
 * increments: half-angle vectors, shape (count, 3).
 * window: the increments of each span, shape (S, m), all less than count, m <= MOST_FACTORS.
 * weights: the basis, its derivative and its second derivative at the nodes, shape (3, m, n).
 * roots: square roots of the nodes' weights, shape (n,), n a multiple of S.
 * inertia: shape (3, 3), or of no rows where acceleration counts, not torque.
 * index: increments of the factors of each keyframe equation, shape (N, F).
 * share: how much of them, shape (N, F).
 * steps: quaternions from keyframe to keyframe, shape (N, 4).
 * gradient: receives the effort's, of each span, shape (S, 3 m).
 * squares: receives the Gauss-Newton matrices, shape (S, 3 m, 3 m).
 * bound: receives the derivatives of the keyframe equations, shape (N, 3, 3 F).
 * missed: receives their errors, shape (N, 3).
 *
 * Return the effort. */
double linearise_effort(matrix_t increments, indices_t window, tensor_t weights, row_t roots,
                        matrix_t inertia, indices_t index, matrix_t share, matrix_t steps,
                        matrix_t gradient, tensor_t squares, tensor_t bound, matrix_t missed);

#endif
