/* What a certificate takes of setpoints. */
#include <stdlib.h>
#include <string.h>

#include "differences.h"

int setpoint_extremes(matrix_t q, index_t past, double start, measure_t how, extremes_t found,
                      slowest_t *slowest) {
    block_t block = {.has_rates = q.n == 10};
    sight_t *sight = calloc(1, sizeof *sight);
    *slowest = (slowest_t){how.law.fastest, 0};
    if (sight == NULL)
        return OUT_OF_MEMORY;
    for (index_t read = 0; read < q.m;) {
        index_t known = block.count, more = least(BLOCK - known, q.m - read);
        for (index_t row = 0; row < q.n; row++)
            memcpy(block.rows[row] + known, row_of(q, row) + read, (size_t)more * sizeof(double));
        block.count += more;
        if (!read)
            note_unknown(&block);
        read += more;
        index_t shift = read - block.count;
        take_differences(&block, how.period, shift ? 0 : past, how.with_axes, how.with_rate, shift,
                         sight, found);
        if (how.with_rate)
            *slowest = slower(sight, shift, &how, *slowest);
        keep_last(&block);
    }
    free(sight);
    return 0;
}
