/* Sample a path that is one row of numbers, and hold its records against limits. */
#include <math.h>
#include <stdlib.h>

#include "clock.h"
#include "differences.h"
#include "fused.h"
#include "plain_path.h"
#include "rotation.h"
#include "sampling.h"

/* Return how many numbers a curve is sampled from. */
static double curve_size(double spans, double factors) {
    if (factors == 0.0)
        return spans + 1.0 + TABLE_ROWS * spans;
    double of_basis = factors + 1.0 + factors + fmax(factors - 1.0, 1.0);
    return spans + 1.0 + 4.0 * spans + factors * spans * (3.0 + 1.0 + of_basis);
}

index_t read_curve(row_t row, curve_t *curve) {
    if (row.n < CURVE_HEAD)
        return 0;
    double spans = row.v[0], factors = row.v[1], room = (double)(row.n - CURVE_HEAD);
    if (!(spans >= 1.0 && spans <= room && factors >= 0.0 && factors <= room
          && spans == floor(spans) && factors == floor(factors)
          && curve_size(spans, factors) <= room))
        return 0;
    *curve = (curve_t){(index_t)spans, (index_t)factors, row.v + CURVE_HEAD};
    return CURVE_HEAD + (index_t)curve_size(spans, factors);
}

index_t read_clock(row_t row, timed_t *clock) {
    double nodes = row.n ? row.v[0] : -1.0;
    if (!(nodes >= 0.0 && nodes != 1.0 && nodes == floor(nodes) && nodes <= (double)row.n))
        return 0;
    index_t n = (index_t)nodes, size = n ? 1 + 4 * n + CLOCK_TAIL : 1;
    if (size > row.n)
        return 0;
    double *tail = row.v + size - CLOCK_TAIL;
    *clock = (timed_t){.times = {row.v + 1, n}};
    if (n)
        *clock = (timed_t){{row.v + 1, n}, {row.v + 1 + n, n}, {row.v + 1 + 2 * n, n},
                           {row.v + 1 + 3 * n, n}, {tail, 2}, tail[2], tail[3]};
    return size;
}

int sample_curve(curve_t curve, row_t times, matrix_t out) {
    index_t spans = curve.spans, m = curve.factors, low = most(m - 1, 1), place;
    double *numbers = (double *)curve.numbers;
    row_t breaks = {numbers, spans + 1};
    numbers += spans + 1;
    if (m == 0) {
        place = sample_cubic(times, breaks, (matrix_t){numbers, TABLE_ROWS, spans}, 0.0, out);
    } else {
        matrix_t base = {numbers, 4, spans};
        tensor_t axes = {base.v + 4 * spans, m, 3, spans};
        matrix_t lengths = {axes.v + 3 * m * spans, m, spans};
        tensor_t values = {lengths.v + m * spans, spans, m, m + 1};
        tensor_t rates = {values.v + spans * m * (m + 1), spans, m, m};
        tensor_t curvatures = {rates.v + spans * m * m, spans, m, low};
        place = sample_product(times, breaks, base, axes, lengths, values, rates, curvatures, 0.0,
                               out);
    }
    /* Instants are inside the domain of every curve whose breaks are numbers. */
    return place == OUT_OF_MEMORY ? OUT_OF_MEMORY : place >= 0 ? NO_PATH : 0;
}

/* Return the place of the first of increasing numbers that is not less than some value. */
static index_t place_of(row_t numbers, double value) {
    index_t low = 0;
    for (index_t n = numbers.n; n > 0;) {
        index_t half = n / 2;
        if (numbers.v[low + half] < value)
            low += half + 1, n -= half + 1;
        else
            n = half;
    }
    return low;
}

/* Write what is held from one instant to the one before another. */
static void hold(const double *orientation, index_t from, index_t to, matrix_t out) {
    for (index_t row = 0; row < out.n; row++)
        for (index_t i = from; i < to; i++)
            row_of(out, row)[i] = row < 4 ? orientation[row] : 0.0;
}

/* Make velocities and accelerations by a curve's own time those by the clock's. */
static void run_faster(double scale, matrix_t paces, double *samples) {
    index_t count = paces.m;
    const double *rate = row_of(paces, 1), *change = row_of(paces, 2);
    for (index_t k = 0; k < 3; k++) {
        double *omega = samples + (4 + k) * count, *alpha = samples + (7 + k) * count;
        for (index_t i = 0; i < count; i++) {
            double r = scale * rate[i];
            alpha[i] = fused(alpha[i], r * r, omega[i] * (scale * change[i]));
            omega[i] *= r;
        }
    }
}

/* Write a stretch from one instant to the one before another. */
static int sample_stretch(const double *head, timed_t clock, curve_t curve, row_t times,
                          index_t from, index_t to, matrix_t out, scratch_t *scratch) {
    double begin = head[0], skipped = head[1], rate = head[2], sign = head[3];
    double first = curve.numbers[0], last = curve.numbers[curve.spans];
    double low = clock.times.n ? 0.0 : first;
    double high = clock.times.n ? clock.times.v[clock.times.n - 1] : last;
    double origin = rate > 0.0 ? low : high;
    for (; from < to; from += PART) {
        index_t count = least(PART, to - from);
        for (index_t i = 0; i < count; i++) {
            double t = fused(times.v[from + i] - begin + skipped, rate, origin);
            scratch->instants[i] = fmin(fmax(t, low), high);
        }
        matrix_t paces = {scratch->paces, 3, count};
        if (clock.times.n) {
            sample_clock(clock.times, clock.places, clock.values, clock.slopes, clock.leaves,
                         (row_t){scratch->instants, count}, paces);
            for (index_t i = 0; i < count; i++) {
                double t = fused(paces.v[i], clock.scale, clock.first);
                scratch->instants[i] = fmin(fmax(t, first), last);
            }
        }
        int failed = sample_curve(curve, (row_t){scratch->instants, count},
                                  (matrix_t){scratch->samples, 10, count});
        if (failed)
            return failed;
        if (clock.times.n && out.n > 4)
            run_faster(clock.scale, paces, scratch->samples);
        for (index_t row = 0; row < out.n; row++) {
            double factor = row < 4 ? sign : row < 7 ? rate : rate * rate;
            const double *samples = scratch->samples + row * count;
            double *to_row = row_of(out, row) + from;
            for (index_t i = 0; i < count; i++)
                to_row[i] = factor * samples[i];
        }
    }
    return 0;
}

int sample_in_parts(row_t path, row_t times, matrix_t out, scratch_t *scratch) {
    if (path.n < PATH_HEAD)
        return NO_PATH;
    index_t final = place_of(times, path.v[1]);
    index_t first = least(place_of(times, 0.0), final);
    hold(path.v + 2, 0, first, out);
    hold(path.v + 6, final, times.n, out);
    row_t rest = {path.v + PATH_HEAD, path.n - PATH_HEAD};
    for (double left = path.v[0]; left > 0.0; left -= 1.0) {
        timed_t clock;
        curve_t curve;
        const double *head = rest.v;
        rest = (row_t){rest.v + STRETCH_HEAD, rest.n - STRETCH_HEAD};
        index_t taken = read_clock(rest, &clock);
        if (!taken)
            return NO_PATH;
        rest = (row_t){rest.v + taken, rest.n - taken};
        taken = read_curve(rest, &curve);
        if (!taken)
            return NO_PATH;
        rest = (row_t){rest.v + taken, rest.n - taken};
        index_t stop = final;
        if (left > 1.0 && rest.n > 0)
            stop = least(place_of(times, rest.v[0]), final);
        int failed = sample_stretch(head, clock, curve, times, first, stop, out, scratch);
        if (failed)
            return failed;
        first = most(first, stop);
    }
    return first == final ? 0 : NO_PATH;
}

int sample_path(row_t path, row_t times, matrix_t out) {
    scratch_t *scratch = malloc(sizeof *scratch);
    if (scratch == NULL)
        return OUT_OF_MEMORY;
    int failed = sample_in_parts(path, times, out, scratch);
    free(scratch);
    return failed;
}

int farthest_from_path(row_t path, row_t times, matrix_t keys, double *angle) {
    double *q = malloc((size_t)(4 * times.n + 1) * sizeof(double));
    if (q == NULL)
        return OUT_OF_MEMORY;
    matrix_t out = {q, 4, times.n};
    int failed = sample_path(path, times, out);
    *angle = 0.0;
    for (index_t i = 0; !failed && i < times.n; i++) {
        quat_t here = quat(row_of(out, 0)[i], row_of(out, 1)[i], row_of(out, 2)[i],
                           row_of(out, 3)[i]);
        double found = angle_between(here, quat_at(row_of(keys, i)));
        if (!(found <= *angle) && *angle == *angle)
            *angle = found;
    }
    free(q);
    return failed;
}
