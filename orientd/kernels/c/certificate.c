/* What a certificate takes of setpoints. */
#include <string.h>

#include "differences.h"

slowest_t setpoint_extremes(matrix_t q, index_t past, double start, measure_t how,
                            extremes_t found) {
    block_t block;
    slowest_t slowest = {how.law.fastest, 0};
    block.count = 0;
    for (index_t read = 0; read < q.m;) {
        index_t known = block.count, more = least(BLOCK - known, q.m - read);
        for (index_t row = 0; row < 4; row++)
            memcpy(block.q[row] + known, row_of(q, row) + read, (size_t)more * sizeof(double));
        block.count += more;
        read += more;
        index_t shift = read - block.count;
        take_differences(&block, shift ? 0 : past, how.with_axes, shift, found);
        if (how.with_rate)
            slowest = slower(&block, shift, start, &how, slowest);
        keep_last(&block);
    }
    return slowest;
}
