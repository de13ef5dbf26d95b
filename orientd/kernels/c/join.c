/* The increments of joins. */
#include "connectors.h"

quat_t put_outer_increments(const motion_t *first, const motion_t *last, double duration,
                            vec_t w[FACTORS]) {
    double tenth = duration / 10.0, bend = duration * duration / 40.0;
    w[0] = times(tenth, first->omega);
    w[1] = plus(w[0], times(bend, first->alpha));
    w[4] = times(tenth, last->omega);
    quat_t fifth = exponential(w[4]);
    w[3] = turned(fifth, minus(w[4], times(bend, last->alpha)));
    quat_t begun = multiplied(first->q, multiplied(exponential(w[0]), exponential(w[1])));
    quat_t ended = multiplied(exponential(w[3]), fifth);
    quat_t middle = multiplied(conjugated(begun), multiplied(last->q, conjugated(ended)));
    return shorter(middle);
}

void put_increments(const motion_t *first, const motion_t *last, double duration,
                    vec_t w[FACTORS]) {
    w[2] = logarithm(put_outer_increments(first, last, duration, w));
}
