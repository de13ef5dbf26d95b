/* Interpolate keyframes by cumulative B-splines, solve banded systems, and measure the effort of a
 * spline: what the kernels of this group offer. */
#ifndef ORIENTD_INTERPOLATION_H
#define ORIENTD_INTERPOLATION_H

#include "arrays.h"

enum { NOT_FOUND = 0, FOUND = 1 };

/* interpolate.c */

/* The conditions for a spline. */
typedef struct {
    matrix_t keys;    /* unit quaternions with the signs wanted, shape (n, 4), n >= 2 */
    matrix_t steps;   /* half-angle vectors from each to the next, shape (n - 1, 3), which may be of more
                       * than half a turn; of no rows, the logarithms */
    row_t times;      /* of the keyframes, increasing, s, shape (n,) */
    index_t order;    /* 3 to 6 */
    tensor_t given;   /* angular velocity and acceleration at the first keyframe and at the last, body
                       * frame, shape (2, 2, 3) */
    index_t known[2]; /* how much of that is a condition there: 0 to 1 for order 3, to 2 for order 4,
                       * 0 or 2 for the others */
    bool is_near;     /* whether the increments that are handed in are near the solution wanted */
} interpolation_t;

/* Whether an end has a condition more than its knots leave free, and so one more knot. */
INLINE bool has_more(const interpolation_t *asked, index_t end) {
    return asked->order == 4 && asked->known[end] == 2;
}

/* The spans of a spline. */
INLINE index_t spans_of(const interpolation_t *asked) {
    return asked->keys.n - 1 + asked->order % 2 + has_more(asked, 0) + has_more(asked, 1);
}

/* Write the cumulative B-spline through keyframes, continuous to its order - 2.
 *
 * breaks: receives the ends of the S spans, shape (S + 1,).
 * base: receives the quaternion before the product of each span, shape (S, 4).
 * increments: receives half-angle vectors, shape (S + order - 2, 3); the first of span s is number s.
 *     Where they are near the solution, Newton's method alone finds it.
 * values: receives the cumulative basis, shape (S, order - 1, order), as fill_basis writes it.
 *
 * Return FOUND, NOT_FOUND or OUT_OF_MEMORY. */
int interpolate(const interpolation_t *asked, row_t breaks, matrix_t base, matrix_t increments,
                tensor_t values);

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
