/* The way from one state to another: by way of rest, which always exists, made as short as the limits
 * permit. */
#include "shorten.h"

index_t connect_states(row_t start, row_t end, matrix_t limits, matrix_t own, double period,
                       double least, double longest, double most_turn, matrix_t q, tensor_t w,
                       row_t breaks) {
    motion_t begin = state_at(start.v), last = state_at(end.v);
    phases_t rests;
    index_t count = 0;
    if (new_phases(begin, &rests)
        && by_way_of_rest(&begin, &last, limits, own, period, least, longest, &rests)) {
        count = shorten_connector(&rests, limits, period, least, most_turn, q, w, breaks);
        if (!count)
            count = put_phases(&rests, q, w, breaks);
    }
    free_phases(&rests);
    return count;
}
