/* Banded linear systems, by Gaussian elimination with row exchanges (Golub and Van Loan, 2013,
 * sec. 4.3.3). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "interpolation.h"

int solve_banded(matrix_t band, index_t lower, index_t upper, matrix_t right) {
    /* By rows, each from the column of its lowest diagonal on; exchanges widen it by lower. */
    index_t n = band.m, reach = lower + upper, stride = reach + lower + 1, k = right.m;
    double *a = calloc((size_t)(n * stride), sizeof *a);
    if (!a)
        return OUT_OF_MEMORY;
    for (index_t d = 0; d <= reach; d++)
        for (index_t j = most(0, upper - d); j < least(n, n + upper - d); j++)
            a[(j + d - upper) * stride + reach - d] = row_of(band, d)[j];
    int found = FOUND;
    for (index_t i = 0; i < n; i++) {
        /* Entry (r, c) of the matrix is a[r * stride + c - r + lower]. */
        index_t rows = least(lower, n - 1 - i), columns = least(reach, n - 1 - i) + 1, best = 0;
        double *pivot = a + i * stride + lower;
        double largest = fabs(*pivot);
        for (index_t r = 1; r <= rows; r++) {
            double size = fabs(pivot[r * (stride - 1)]);
            if (size > largest)
                largest = size, best = r;
        }
        if (!(largest > 0.0 && largest < INFINITY)) {
            found = NOT_FOUND;
            break;
        }
        double *to = row_of(right, i);
        if (best) {
            double *other = pivot + best * (stride - 1), *from = row_of(right, i + best);
            for (index_t c = 0; c < columns; c++) {
                double held = pivot[c];
                pivot[c] = other[c], other[c] = held;
            }
            for (index_t c = 0; c < k; c++) {
                double held = to[c];
                to[c] = from[c], from[c] = held;
            }
        }
        for (index_t r = 1; r <= rows; r++) {
            double *restrict row = pivot + r * (stride - 1), *restrict here = pivot;
            double factor = row[0] / here[0];
            if (factor == 0.0)
                continue;
            for (index_t c = 1; c < columns; c++)
                row[c] -= factor * here[c];
            for (index_t c = 0; c < k; c++)
                to[r * k + c] -= factor * to[c];
        }
    }
    for (index_t i = n - 1; i >= 0 && found == FOUND; i--) {
        const double *row = a + i * stride + lower;
        double *to = row_of(right, i);
        index_t columns = least(reach, n - 1 - i);
        for (index_t c = 0; c < k; c++) {
            double total = to[c];
            for (index_t j = 1; j <= columns; j++)
                total -= row[j] * to[j * k + c];
            to[c] = total / row[0];
        }
    }
    free(a);
    return found;
}
