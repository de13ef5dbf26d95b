/* Backward differences of a block of records, and of what is drawn between them, and the largest.
 *
 * A device knows setpoints, not derivatives.  It takes the rotation vector from one setpoint to
 * the next over a period for the velocity, the change of that for the acceleration and the change
 * of that for the jerk.
 */
#include <math.h>
#include <string.h>

#include "differences.h"
#include "rotation.h"

/* Square of the tangent of the half angle, below which the series of atan(t) / t is exact to the
 * last digit. */
#define SMALL (1.0 / 1024.0)

/* From a largest square to the same on the records alone. */
enum { ON_RECORDS = 12 };

void note_unknown(block_t *block) {
    block->unknown = 0;
    while (block->has_rates && block->unknown < block->count
           && isnan(block->rows[4][block->unknown]))
        block->unknown++;
}

void keep_last(block_t *block) {
    index_t kept = least(block->count, KEPT);
    for (index_t row = 0; row < (block->has_rates ? 10 : 4); row++)
        memmove(block->rows[row], block->rows[row] + block->count - kept,
                (size_t)kept * sizeof(double));
    block->unknown = most(block->unknown - (block->count - kept), 0);
    block->count = kept;
}

/* Write the rotation vectors between setpoints, and return how many are too large for that. */
static index_t turn_near(seen_t *seen) {
    index_t large = 0, count = seen->count - 1;
    double (*restrict q)[BLOCK] = seen->q, (*restrict omega)[BLOCK] = seen->rates[0];
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

INLINE quat_t setpoint(const seen_t *seen, index_t i) {
    return quat(seen->q[0][i], seen->q[1][i], seen->q[2][i], seen->q[3][i]);
}

/* Write the rotation vectors that the series is not good for. */
static void turn_far(seen_t *seen) {
    for (index_t i = 0; i + 1 < seen->count; i++) {
        quat_t turn = multiplied(conjugated(setpoint(seen, i)), setpoint(seen, i + 1));
        if (turn.w < 0.0)
            turn = quat(-turn.w, -turn.x, -turn.y, -turn.z);
        if (turn.x * turn.x + turn.y * turn.y + turn.z * turn.z < SMALL * (turn.w * turn.w))
            continue;
        vec_t half = logarithm(turn);
        seen->rates[0][0][i] = 2.0 * half.x;
        seen->rates[0][1][i] = 2.0 * half.y;
        seen->rates[0][2][i] = 2.0 * half.z;
    }
}

/* Write the changes of the rotation vectors, the changes of those, and all squared norms. */
static void differ(seen_t *seen) {
    for (index_t order = 0; order < 3; order++) {
        index_t count = seen->count - 1 - order;
        double (*restrict rates)[BLOCK] = seen->rates[order];
        double *restrict squares = seen->squares[order];
        if (order)
            for (index_t k = 0; k < 3; k++) {
                const double *lower = seen->rates[order - 1][k];
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

/* Take the differences of setpoints. */
static void see(seen_t *seen) {
    if (turn_near(seen))
        turn_far(seen);
    differ(seen);
}

/* Forget differences that begin at a place before one. */
static void forget(seen_t *seen, index_t known) {
    for (index_t order = 0; order < 3; order++)
        for (index_t i = 0; i < known; i++) {
            seen->squares[order][i] = -1.0;
            for (index_t k = 0; k < 3; k++)
                seen->rates[order][k][i] = 0.0;
        }
}

/* Write the largest values between neighbours in time: at the vertex of the parabola through three,
 * where the middle one is the largest. */
static void put_vertices(const double *left, const double *here, const double *right, index_t n,
                         double *restrict to) {
    INDEPENDENT
    for (index_t i = 0; i < n; i++) {
        double l = left[i], h = here[i], r = right[i];
        double bend = 2.0 * h - l - r, lean = r - l;
        bool is_top = (l >= 0.0) & (r >= 0.0) & (h >= l) & (h >= r) & (bend > 0.0);
        to[i] = is_top ? h + lean * lean / (8.0 * bend) : h;
    }
}

/* Note the largest of squares that follow one another from phase to phase, and of the first one's. */
static void note_phases(double (*squares)[BLOCK], int phases, const index_t *ends, index_t first,
                        index_t shift, double *largest, int64_t *place) {
    double tops[BLOCK];
    int64_t unused;
    note(squares[0], first, ends[0], shift, largest + ON_RECORDS, &unused);
    if (phases == 1) {
        note(squares[0], first, ends[0], shift, largest, place);
        return;
    }
    for (int p = 0; p < phases; p++) {
        const double *here = squares[p];
        const double *left = p ? squares[p - 1] : squares[phases - 1] - 1;
        const double *right = p + 1 < phases ? squares[p + 1] : squares[0] + 1;
        /* The first on a record has no neighbour before it, the last no other after it. */
        index_t begin = p ? first : first + 1, end = least(ends[p], ends[1]);
        for (index_t i = first; i < ends[p]; i++)
            tops[i] = here[i];
        if (begin < end)
            put_vertices(left + begin, here + begin, right + begin, end - begin, tops + begin);
        note(tops, first, ends[p], shift, largest, place);
    }
}

void take_differences(const block_t *block, double period, index_t past, bool with_axes,
                      index_t shift, sight_t *sight, extremes_t found) {
    seen_t *at = sight->at;
    sight->phases = block->has_rates ? PHASES : 1;
    for (int p = 0; p < sight->phases; p++)
        at[p].count = p ? block->count - 1 : block->count;
    if (block->count < 2)
        return;
    memcpy(at->q, block->rows, sizeof at->q);
    see(at);
    if (sight->phases > 1)
        draw_between(block, period, at->rates[0][0], at);
    for (int p = 1; p < sight->phases; p++) {
        see(at + p);
        forget(at + p, block->unknown);
    }
    for (index_t order = 0; order < 3; order++) {
        index_t first = (2 - order) * past, ends[PHASES];
        double *largest = found.squares + 4 * order, squares[PHASES][BLOCK];
        int64_t *places = found.places + 4 * order;
        for (int p = 0; p < sight->phases; p++) {
            ends[p] = most(at[p].count - 1 - order, 0);
            memcpy(squares[p], at[p].squares[order], sizeof squares[p]);
        }
        note_phases(squares, sight->phases, ends, first, shift, largest, places);
        for (index_t k = 0; with_axes && k < 3; k++) {
            for (int p = 0; p < sight->phases; p++) {
                const double *component = at[p].rates[order][k];
                for (index_t i = first; i < ends[p]; i++)
                    squares[p][i] = at[p].squares[order][i] < 0.0 ? -1.0
                                                                  : component[i] * component[i];
            }
            note_phases(squares, sight->phases, ends, first, shift, largest + 1 + k,
                        places + 1 + k);
        }
    }
}
