/* Joins: their increments, and what a curve of several is sampled from. */
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

void put_joins(matrix_t q, tensor_t w, row_t breaks, matrix_t base, tensor_t axes,
               matrix_t lengths, tensor_t values, tensor_t rates, tensor_t curvatures,
               matrix_t at_ends) {
    index_t count = q.n;
    for (index_t i = 0; i < count; i++) {
        vec_t of[FACTORS];
        for (int k = 0; k < FACTORS; k++)
            of[k] = vec_at(w.v + (i * FACTORS + k) * 3);
        join_t here = join_of(of, breaks.v[i + 1] - breaks.v[i]);
        double rate = here.per_second;
        for (int c = 0; c < 4; c++)
            row_of(base, c)[i] = row_of(q, i)[c];
        for (int k = 0; k < FACTORS; k++) {
            row_of(lengths, k)[i] = here.length[k];
            double *axis = axes.v + 3 * k * count + i;
            axis[0] = here.axis[k].x, axis[count] = here.axis[k].y;
            axis[2 * count] = here.axis[k].z;
            double *value = values.v + (i * FACTORS + k) * 6;
            double *slope = rates.v + (i * FACTORS + k) * 5;
            double *bend = curvatures.v + (i * FACTORS + k) * 4;
            for (int j = 0; j < 6; j++)
                value[j] = j > k ? 1.0 : 0.0;
            for (int j = 0; j < 5; j++)
                slope[j] = j == k ? 5.0 * rate : 0.0;
            for (int j = 0; j < 4; j++)
                bend[j] = (j == k - 1 ? 20.0 : j == k ? -20.0 : 0.0) * rate * rate;
        }
        for (int end = 0; end < 2; end++) {
            if (i != (end ? count - 1 : 0))
                continue;
            double sample[STATE];
            put_state(sample, join_at(quat_at(row_of(q, i)), &here, join_basis(end)));
            for (int row = 0; row < STATE; row++)
                row_of(at_ends, row)[end] = sample[row];
        }
    }
}
