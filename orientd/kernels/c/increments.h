/* The equations of an interpolating cumulative B-spline, and their Newton steps. */
#ifndef ORIENTD_INCREMENTS_H
#define ORIENTD_INCREMENTS_H

#include "interpolation.h"
#include "rotation.h"

enum { MOST_TIES = 2, OUTERMOST = 3 };

/* One equation for each of n intervals between keyframes, in n + 2 c increments, half-angle vectors.
 *
 * Between two neighbouring keyframes all but a few factors of the product are complete or not begun:
 *
 *     prod_f exp(b_if w_i+f)^-1 exp(w_i) prod_f exp(b_i+1,f w_i+1+f),   f = 0 .. 2 c - 1,
 *
 * has to be the turn from the one to the other; b_if says how much of factor i + f has been turned
 * at keyframe i.  Each end adds c linear conditions on its three outermost increments.  Increments
 * are never taken from logarithms of control quaternions, so they may pass pi and keep their whole
 * turns.
 *
 * Steps and known values carry a common scale: at 0 nothing turns, at 1 they have their full size.
 */
typedef struct {
    index_t rows;   /* n */
    index_t ties;   /* c, 1 or 2 */
    index_t count;  /* increments: n + 2 c */
    index_t stride; /* between the rows of the arrays below */
    double *share;  /* b, a row for each f, a column for each keyframe */
    double *step;   /* half-angle vectors from keyframe to keyframe: length and unit axis, 4 rows */
    double at_end[2][MOST_TIES][OUTERMOST]; /* coefficients of the conditions, from the end inwards */
    vec_t known[2][MOST_TIES];              /* their right sides */
    /* Increments outside of the system that are taken off the first and the last step. */
    index_t taken[2];
    vec_t off[2][2]; /* from the end inwards */

    double *w;      /* the increments, shape (count, 3) */
    double *change; /* the last Newton step, shape (count, 3) */
    double *rate;   /* derivative of the solution by the scale, as good as the increments are */
    double error;   /* sum of the squared errors before that step */

    double *target, *length, *inverse, *axis, *kept; /* scratch */
    void *memory;
} system_t;

/* Take memory for a system, all of it zero, and return whether there was any; to be freed. */
bool new_system(index_t rows, index_t ties, system_t *system);

/* Write a Newton step at a scale, and the rate there, and return the largest component of the step;
 * not a number where one is not finite. */
double correct(system_t *system, double scale);

/* search.c: write the increments that solve a system; FOUND, NOT_FOUND or OUT_OF_MEMORY. */
int solve_increments(system_t *system);

/* search.c: improve increments that are near a solution; FOUND or NOT_FOUND. */
int settle_increments(system_t *system);

#endif
