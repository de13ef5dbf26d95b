/* Backward differences of setpoints, a block of records at a time: what kernels that certify
 * share. */
#ifndef ORIENTD_DIFFERENCES_H
#define ORIENTD_DIFFERENCES_H

#include "certify.h"

/* Records in a block; each but the first begins with the last KEPT of the one before, so that every
 * difference has those before and after it in one block. */
enum { BLOCK = 256, KEPT = HISTORY + 2 };

/* Places between two records at which differences are taken, the record itself being the first: a
 * stop, a pause or another speed leaves the device anywhere between the records. */
enum { PHASES = 4 };

/* Records: orientations, and angular velocities and accelerations where there are any.  The first
 * ones may have none of the latter, being not numbers. */
typedef struct {
    double rows[10][BLOCK];
    index_t count, unknown;
    bool has_rates;
} block_t;

/* Setpoints with their first three differences and the squared norms of these, which are -1 where a
 * difference is not known. */
typedef struct {
    double q[4][BLOCK];
    double rates[3][3][BLOCK];
    double squares[3][BLOCK];
    index_t count;
} seen_t;

/* Setpoints on the records of a block and at as many places between them as differ. */
typedef struct { seen_t at[PHASES]; int phases; } sight_t;

/* Note how many of the first records have no velocity. */
void note_unknown(block_t *block);

/* Move the last records of a block to its beginning, and leave nothing else in it. */
void keep_last(block_t *block);

/* Take the differences of a block, and note the largest at any phase.
 *
 * period: from one record to the next, s.
 * past: as in setpoint_extremes.
 * shift: what to add to a place in the block. */
void take_differences(const block_t *block, double period, index_t past, bool with_axes,
                      index_t shift, sight_t *sight, extremes_t found);

/* Return the least brake rate of a block at any phase, or what it was before.
 *
 * start: path time of the fourth setpoint of all, s. */
slowest_t slower(const sight_t *sight, index_t shift, double start, const measure_t *how,
                 slowest_t before);

/* drawn.c */

/* Write the orientations that the servo draws between the records of a block.
 *
 * turns: rotation vectors from each record to the next, rows of BLOCK.
 * at: setpoints at the phases, of which all but the first are written. */
void draw_between(const block_t *block, double period, const double *turns, seen_t *at);

#endif
