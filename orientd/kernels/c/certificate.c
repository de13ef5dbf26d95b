/* Certify records, a block after the other. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "differences.h"

int certify(matrix_t rows, index_t past, measure_t how, extremes_t found, slowest_t *slowest,
            index_t *unproven) {
    block_t block = {.has_rates = rows.n == 10};
    sight_t *sight = calloc(1, sizeof *sight);
    *slowest = (slowest_t){how.law.fastest, 0};
    if (sight == NULL)
        return OUT_OF_MEMORY;
    /* What is less than the bounds so far need not be looked at closely. */
    for (index_t slot = 0; slot < 12; slot++)
        sight->known[slot / 4][slot % 4] = sqrt(found.squares[slot]) / (1.0 + SLACK);
    sight->boxes = BOXES_AT_LEAST + BOXES_A_RECORD * rows.m;
    for (index_t read = 0; read < rows.m;) {
        index_t known = block.count, more = least(BLOCK - known, rows.m - read);
        for (index_t row = 0; row < rows.n; row++)
            memcpy(block.rows[row] + known, row_of(rows, row) + read,
                   (size_t)more * sizeof(double));
        block.count += more;
        if (!read)
            note_unknown(&block);
        read += more;
        index_t shift = read - block.count;
        take_differences(&block, how.period, shift ? 0 : past, how.with_axes, how.is_certificate,
                         shift, sight, found);
        if (how.is_certificate)
            *slowest = slower(sight, shift, &how, *slowest);
        keep_last(&block);
    }
    *unproven = sight->unproven;
    free(sight);
    return 0;
}
