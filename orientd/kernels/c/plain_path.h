/* A path of cumulative products as one row of numbers; orientd.planner.path.plain_path writes it.
 *
 * The row begins with the number of stretches, the path time from which on the path is held, and
 * the orientations before it and after it.  Of each stretch follow when it begins, what is skipped
 * of it, its rate and its sign, then its clock and then its curve.  The clock is the number of its
 * nodes, 0 where the curve runs on its own time, or that number, times, places, squared rates and
 * slopes of the nodes, two lengths over which it leaves rest, the curve's first instant and its
 * seconds for a second of the clock, see clock.h.  The curve is how many spans and factors it has,
 * and what it is sampled from.  That is breaks and table of cubic factors, for which the number of factors
 * is given as 0, or breaks, base, axes, lengths and the coefficients of the basis.
 */
#ifndef ORIENTD_PLAIN_PATH_H
#define ORIENTD_PLAIN_PATH_H

#include "arrays.h"

enum {
    PATH_HEAD = 10,
    STRETCH_HEAD = 4,
    CLOCK_TAIL = 4,
    CURVE_HEAD = 2,
    PART = 512,  /* instants that are sampled at a time */
};

typedef struct { index_t spans, factors; const double *numbers; } curve_t;

/* Of no nodes where there is none. */
typedef struct { row_t times, places, values, slopes, leaves; double first, scale; } timed_t;

/* Memory for instants of a curve, its clock and its samples. */
typedef struct { double instants[PART], paces[3 * PART], samples[10 * PART]; } scratch_t;

/* Read the clock at the beginning of a row, and return how many numbers it takes; 0 if there is
 * none. */
index_t read_clock(row_t row, timed_t *clock);

/* Read the curve at the beginning of a row, and return how many numbers it takes; 0 if there is
 * none. */
index_t read_curve(row_t row, curve_t *curve);

/* Write samples of a curve at instants in its domain, shape (10, n). */
int sample_curve(curve_t curve, row_t times, matrix_t out);

/* Write a path at increasing instants; rows of out may be further apart than times.n numbers. */
int sample_in_parts(row_t path, row_t times, matrix_t out, scratch_t *scratch);

#endif
