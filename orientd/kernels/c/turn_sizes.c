/* The largest turns from one setpoint to another, period by period; see certify.h. */
#include <stdlib.h>

#include "certify.h"
#include "lane_log.h"

enum { LANES = 3, COLUMNS = 4 };

/* Write the rotation vectors from each orientation to the one *reach* later, lane by lane. */
static void put_turns(matrix_t q, index_t reach, index_t stride, double *restrict x) {
    double *restrict y = x + stride, *restrict z = y + stride;
    const double *restrict from = q.v, *restrict to = q.v + COLUMNS * reach;
    index_t count = q.n - reach;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        quat_t p = quat_at(from + COLUMNS * i), then = quat_at(to + COLUMNS * i);
        quat_t turn = multiplied(conjugated(p), then);
        double sign = turn.w < 0.0 ? -1.0 : 1.0;
        turn = quat(sign * turn.w, sign * turn.x, sign * turn.y, sign * turn.z);
        vec_t half = lane_logarithm(turn, 1.0);
        x[i] = 2.0 * half.x, y[i] = 2.0 * half.y, z[i] = 2.0 * half.z;
    }
}

/* Replace each vector by its difference from the one *reach* before. */
static void subtract(double *lane, index_t count, index_t reach) {
    for (index_t i = 0; i < count; i++)
        lane[i] = lane[i + reach] - lane[i];
}

int turn_sizes(matrix_t q, index_t order, index_t reach, index_t parts, matrix_t out) {
    index_t count = q.n - order * reach, lead = order * reach;
    double *turns = malloc((size_t)(LANES * q.n) * sizeof *turns);
    if (turns == NULL)
        return OUT_OF_MEMORY;
    put_turns(q, reach, q.n, turns);
    for (index_t k = 1; k < order; k++)
        for (int lane = 0; lane < LANES; lane++)
            subtract(turns + lane * q.n, q.n - (k + 1) * reach, reach);
    const double *x = turns, *y = x + q.n, *z = y + q.n;
    for (index_t row = 0; row < out.n; row++) {
        index_t begin = most(row * parts - lead, 0);
        index_t end = least((row + 1) * parts - lead, count);
        double largest[COLUMNS] = {0.0, 0.0, 0.0, 0.0};
        for (index_t i = begin; i < end; i++) {
            double square = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
            largest[0] = larger(largest[0], square);
            largest[1] = larger(largest[1], fabs(x[i]));
            largest[2] = larger(largest[2], fabs(y[i]));
            largest[3] = larger(largest[3], fabs(z[i]));
        }
        double *to = row_of(out, row);
        to[0] = sqrt(largest[0]), to[1] = largest[1], to[2] = largest[2], to[3] = largest[3];
    }
    free(turns);
    return 0;
}
