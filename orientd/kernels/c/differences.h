/* Backward differences of setpoints, a block at a time: what kernels that certify share. */
#ifndef ORIENTD_DIFFERENCES_H
#define ORIENTD_DIFFERENCES_H

#include "certify.h"

/* Setpoints in a block; each but the first begins with the last HISTORY of the one before. */
enum { BLOCK = 256 };

/* Setpoints, with their first three differences and the squared norms of these. */
typedef struct {
    double q[4][BLOCK];
    double rates[3][3][BLOCK];
    double squares[3][BLOCK];
    index_t count;
} block_t;

/* Move the last setpoints of a block to its beginning, and leave nothing else in it. */
void keep_last(block_t *block);

/* Take the differences of a block, and note the largest.
 *
 * past: as in setpoint_extremes.
 * shift: what to add to a place in the block. */
void take_differences(block_t *block, index_t past, bool with_axes, index_t shift,
                      extremes_t found);

/* Return the least brake rate of a block, or what it was before.
 *
 * block: with its differences.
 * start: path time of the fourth setpoint of all, s. */
slowest_t slower(const block_t *block, index_t shift, double start, const measure_t *how,
                 slowest_t before);

#endif
