/* Backward differences of a block of setpoints and the largest of them.
 *
 * A device knows setpoints, not derivatives.  It takes the rotation vector from one setpoint to
 * the next over a period for the velocity, the change of that for the acceleration and the change
 * of that for the jerk.
 */
#include <string.h>

#include "differences.h"
#include "rotation.h"

/* Square of the tangent of the half angle, below which the series of atan(t) / t is exact to the
 * last digit. */
#define SMALL (1.0 / 1024.0)

void keep_last(block_t *block) {
    index_t kept = least(block->count, HISTORY);
    for (index_t row = 0; row < 4; row++)
        memmove(block->q[row], block->q[row] + block->count - kept, (size_t)kept * sizeof(double));
    block->count = kept;
}

/* Write the rotation vectors between setpoints, and return how many are too large for that. */
static index_t turn_near(block_t *block) {
    index_t large = 0, count = block->count - 1;
    double (*restrict q)[BLOCK] = block->q, (*restrict omega)[BLOCK] = block->rates[0];
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        double a = q[0][i], b = q[1][i], c = q[2][i], d = q[3][i];
        double e = q[0][i + 1], f = q[1][i + 1], g = q[2][i + 1], h = q[3][i + 1];
        double w = a * e + b * f + c * g + d * h;
        double x = a * f - b * e - c * h + d * g;
        double y = a * g + b * h - c * e - d * f;
        double z = a * h - b * g + c * f - d * e;
        double square = (x * x + y * y + z * z) / (w * w);
        large += !(square < SMALL);
        double rest = 1.0 / 5 - square * (1.0 / 7 - square * (1.0 / 9 - square / 11));
        double factor = 2.0 * (1.0 - square * (1.0 / 3 - square * rest)) / w;
        omega[0][i] = factor * x, omega[1][i] = factor * y, omega[2][i] = factor * z;
    }
    return large;
}

INLINE quat_t setpoint(const block_t *block, index_t i) {
    return quat(block->q[0][i], block->q[1][i], block->q[2][i], block->q[3][i]);
}

/* Write the rotation vectors that the series is not good for. */
static void turn_far(block_t *block) {
    for (index_t i = 0; i + 1 < block->count; i++) {
        quat_t turn = multiplied(conjugated(setpoint(block, i)), setpoint(block, i + 1));
        if (turn.w < 0.0)
            turn = quat(-turn.w, -turn.x, -turn.y, -turn.z);
        if (turn.x * turn.x + turn.y * turn.y + turn.z * turn.z < SMALL * (turn.w * turn.w))
            continue;
        vec_t half = logarithm(turn);
        block->rates[0][0][i] = 2.0 * half.x;
        block->rates[0][1][i] = 2.0 * half.y;
        block->rates[0][2][i] = 2.0 * half.z;
    }
}

/* Write the changes of the rotation vectors, the changes of those, and all squared norms. */
static void differ(block_t *block) {
    for (index_t order = 0; order < 3; order++) {
        index_t count = block->count - 1 - order;
        double (*restrict rates)[BLOCK] = block->rates[order];
        double *restrict squares = block->squares[order];
        if (order)
            for (index_t k = 0; k < 3; k++) {
                const double *lower = block->rates[order - 1][k];
                double *higher = rates[k];
                INDEPENDENT
                for (index_t i = 0; i < count; i++)
                    higher[i] = lower[i + 1] - lower[i];
            }
        INDEPENDENT
        for (index_t i = 0; i < count; i++)
            squares[i] = rates[0][i] * rates[0][i] + rates[1][i] * rates[1][i]
                       + rates[2][i] * rates[2][i];
    }
}

/* Note the largest of some squares; one that is not a number is, and stays, the largest. */
static void note(const double *squares, index_t first, index_t end, index_t shift,
                 double *largest, int64_t *place) {
    double known = *largest;
    index_t larger = 0;
    for (index_t i = first; i < end; i++)
        larger += !(squares[i] <= known);
    if (!larger)
        return;
    for (index_t i = first; i < end; i++)
        if (!(squares[i] <= *largest) && *largest < INFINITY)
            *largest = squares[i], *place = shift + i;
}

void take_differences(block_t *block, index_t past, bool with_axes, index_t shift,
                      extremes_t found) {
    if (block->count < 2)
        return;
    if (turn_near(block))
        turn_far(block);
    differ(block);
    for (index_t order = 0; order < 3; order++) {
        index_t first = (2 - order) * past, end = block->count - 1 - order;
        double *largest = found.squares + 4 * order;
        int64_t *places = found.places + 4 * order;
        note(block->squares[order], first, end, shift, largest, places);
        for (index_t k = 0; with_axes && k < 3; k++) {
            double squares[BLOCK];
            const double *component = block->rates[order][k];
            for (index_t i = first; i < end; i++)
                squares[i] = component[i] * component[i];
            note(squares, first, end, shift, largest + 1 + k, places + 1 + k);
        }
    }
}
