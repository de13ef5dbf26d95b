/* Choose times for keyframes without times, so that the motion through them is as quick as possible.
 *
 * The cubic through keyframes depends on the share of time that each interval gets.  The search first
 * tries powers of the angles between keyframes, then descends along the gradient of the duration.
 * This gradient needs no further search.  At the best profile of a barrier method, the duration of
 * another path differs by the change of its barrier, to first order (the envelope theorem).
 */
#ifndef ORIENTD_KNOT_TIMES_H
#define ORIENTD_KNOT_TIMES_H

#include "arrays.h"

/* The problem to solve. */
typedef struct {
    matrix_t keys;      /* unit quaternions with the signs wanted, shape (n, 4), n >= 3 */
    row_t lengths;      /* of the turns between them, shape (n - 1,) */
    matrix_t limits;    /* of velocity, acceleration and jerk, norm and components, shape (3, 4) */
    double total;       /* time from the first to the last on the curve that is made, s */
    index_t pieces;     /* elements of an interval */
    index_t descents;   /* down the slope, at most; of 0 one other power is tried, and no more */
} knots_t;

/* Write times from 0 to the total, shape (n,), and of the profile that was found COEFFICIENTS and SHARES
 * (timing.h), shape (4, (n - 1) pieces + 2).
 *
 * Return FOUND, NOT_FOUND or OUT_OF_MEMORY.  NOT_FOUND means that no times are quicker than those by
 * the lengths on the curve of an even pace, whose ends have no acceleration. */
int choose_knots(knots_t asked, row_t times, matrix_t profile);

#endif
