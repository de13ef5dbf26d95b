/* B-spline bases on their knot spans, summed to cumulative ones (Kim, Kim and Shin, 1995).
 *
 * Every basis function is held, span by span, by its Bernstein coefficients: the recurrence of Cox
 * and de Boor only ever adds positive terms there, so the values are good to the last digits for
 * any order and any ratio of knot intervals.  Derivatives come from their own formulas, not from
 * differences of the values, which would cancel on spans much shorter than their neighbours.
 */
#include <stdlib.h>
#include <string.h>

#include "sampling.h"

/* Add a polynomial of degree degree - 1 in Bernstein form times a straight line, which is given by
 * its values at both ends. */
static void add_times_line(const double *coefficients, index_t degree, double at_start,
                           double at_end, double *out) {
    double share = 1.0 / (double)degree;
    for (index_t j = 0; j < degree; j++) {
        out[j] += (double)(degree - j) * share * at_start * coefficients[j];
        out[j + 1] += (double)(j + 1) * share * at_end * coefficients[j];
    }
}

/* Take the B-splines that are not zero on a span from one degree to the next. */
static void raise_degree(const double *knots, index_t span, index_t degree, index_t order,
                         const double *lower, double *higher) {
    double here = knots[span], there = knots[span + 1];
    for (index_t row = 0; row < degree; row++) {
        index_t begin = span - degree + 1 + row;
        double start = knots[begin], stop = knots[begin + degree], over = 1.0 / (stop - start);
        const double *part = lower + row * order;
        add_times_line(part, degree, (here - start) * over, (there - start) * over,
                       higher + (row + 1) * order);
        add_times_line(part, degree, (stop - here) * over, (stop - there) * over,
                       higher + row * order);
    }
}

static void put_rates(const double *knots, index_t span, index_t order, const double *lower,
                      const double *lowest, double *rates, double *curvatures, index_t terms) {
    for (index_t row = 0; row < order - 1; row++) {
        index_t index = span - order + 2 + row;
        double scale = (double)(order - 1) / (knots[index + order - 1] - knots[index]);
        for (index_t d = 0; d < order - 1; d++)
            rates[row * (order - 1) + d] = scale * lower[row * order + d];
        for (index_t d = 0; d < terms; d++) {
            double slope = 0.0;
            if (row > 0)
                slope += (double)(order - 2) / (knots[index + order - 2] - knots[index])
                         * lowest[(row - 1) * order + d];
            if (row < order - 2)
                slope -= (double)(order - 2) / (knots[index + order - 1] - knots[index + 1])
                         * lowest[row * order + d];
            curvatures[row * terms + d] = scale * slope;
        }
    }
}

int fill_basis(indices_t spans, row_t knots, index_t order, tensor_t values, tensor_t rates,
               tensor_t curvatures) {
    index_t m = order - 1;
    size_t stage = (size_t)(order * order);
    /* The B-splines of the last degrees, each in one of three places in turn. */
    double *stages = malloc(3 * stage * sizeof *stages);
    if (stages == NULL)
        return OUT_OF_MEMORY;
    for (index_t s = 0; s < spans.n; s++) {
        index_t span = spans.v[s];
        double *lower = stages, *highest = stages + stage, *lowest = stages + 2 * stage;
        highest[0] = 1.0;
        for (index_t degree = 1; degree < order; degree++) {
            double *free = lowest;
            lowest = lower, lower = highest, highest = free;
            memset(highest, 0, (size_t)((degree + 1) * order) * sizeof *highest);
            raise_degree(knots.v, span, degree, order, lower, highest);
        }
        for (index_t d = 0; d < order; d++) {
            double total = 0.0;
            for (index_t row = m; row > 0; row--) {
                total += highest[row * order + d];
                values.v[(s * m + row - 1) * order + d] = total;
            }
        }
        if (!rates.n)
            continue;
        double *bends = curvatures.v + s * m * curvatures.k;
        bends[0] = 0.0;  /* all there is of straight lines */
        put_rates(knots.v, span, order, lower, lowest, rates.v + s * m * m, bends, m - 1);
    }
    free(stages);
    return 0;
}
