/* The way from one state to another: by way of rest, which always exists, made as short as the limits
 * permit. */
#include "shorten.h"

index_t connect_states(row_t start, row_t end, matrix_t limits, matrix_t own, double period,
                       double least, double longest, double most_turn, double more,
                       row_t breaks, matrix_t pieces) {
    motion_t begin = state_at(start.v), last = state_at(end.v);
    phases_t rests;
    index_t count = 0;
    if (new_phases(begin, &rests)
        && by_way_of_rest(&begin, &last, limits, own, period, least, longest, &rests)
        && shorten_connector(&rests, limits, period, least, most_turn, more))
        count = put_phases(&rests, breaks, pieces);
    free_phases(&rests);
    return count;
}
