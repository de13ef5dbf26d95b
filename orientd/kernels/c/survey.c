/* A quick look at a motion: how much longer it should be, and where that is decided. */
#include <math.h>
#include <stdlib.h>

#include "differences.h"
#include "fused.h"
#include "trajectory.h"

index_t put_instants(row_t breaks, double duration, index_t pieces, row_t shares, row_t instants) {
    bool few = breaks.n < pieces;
    index_t i = 0, j = 0, count = 0;
    double before = -1.0;
    /* Those of the curve, and of as many equal pieces where it has but few, in order. */
    while (i < breaks.n || (few && j <= pieces)) {
        double own = i < breaks.n ? breaks.v[i] : INFINITY;
        double other = few && j <= pieces ? duration * (double)j / (double)pieces : INFINITY;
        bool is_own = i < breaks.n && !(own > other);
        double here = is_own ? own : other;
        j += few && j <= pieces && !(other > own);
        i += is_own;
        if (!(here >= 0.0 && here <= duration))
            continue;
        if (here > before && before >= 0.0)
            for (index_t k = 0; k < shares.n; k++)
                instants.v[count++] = before + (here - before) * shares.v[k];
        before = here;
    }
    return count;
}

/* Return a rate as a share of its limits, of the norm or of a component. */
INLINE double share(double x, double y, double z, const double *limits) {
    double most = fmax(fabs(y) / limits[2], fabs(z) / limits[3]);
    most = fmax(fabs(x) / limits[1], most);
    return fmax(sqrt(x * x + y * y + z * z) / limits[0], most);
}

void put_factors(row_t instants, matrix_t omega, matrix_t alpha, double period, matrix_t limits,
                 double step, row_t factors) {
    const double *wx = row_of(omega, 0), *wy = row_of(omega, 1), *wz = row_of(omega, 2);
    const double *ax = row_of(alpha, 0), *ay = row_of(alpha, 1), *az = row_of(alpha, 2);
    for (index_t i = 0; i < instants.n; i++) {
        double factor = share(wx[i], wy[i], wz[i], row_of(limits, 0));
        factor = fmax(factor, sqrt(share(ax[i], ay[i], az[i], row_of(limits, 1))));
        if (i) {
            /* What lies within a period counts as a step of the acceleration over one. */
            double elapsed = fmax(instants.v[i] - instants.v[i - 1], period);
            double twist = share(ax[i] - ax[i - 1], ay[i] - ay[i - 1], az[i] - az[i - 1],
                                 row_of(limits, 2)) / elapsed;
            factor = fmax(factor, step > 0.0 ? sqrt(step * twist) : cbrt(twist));
        }
        factors.v[i] = factor;
    }
}

/* Add a spot behind those before it, or make the last ones longer; return how many there are. */
static index_t put_spot(double begin, double end, index_t count, matrix_t spots) {
    for (; count && begin <= row_of(spots, count - 1)[1]; count--) {
        begin = fmin(begin, row_of(spots, count - 1)[0]);
        end = fmax(end, row_of(spots, count - 1)[1]);
    }
    row_of(spots, count)[0] = begin;
    row_of(spots, count)[1] = end;
    return count + 1;
}

index_t put_spots(row_t instants, row_t factors, double hot, matrix_t ends, matrix_t spots) {
    index_t found = 0;
    if (ends.n)
        found = put_spot(row_of(ends, 0)[0], row_of(ends, 0)[1], found, spots);
    for (index_t i = 0; i < instants.n; i++)
        if (factors.v[i] >= hot)
            found = put_spot(instants.v[most(i - 1, 0)], instants.v[least(i + 1, instants.n - 1)],
                             found, spots);
    if (ends.n)
        found = put_spot(row_of(ends, 1)[0], row_of(ends, 1)[1], found, spots);
    return found;
}

/* What is looked at in the end: some records, and what the device holds before and after them. */
static void see_records(look_t motion, index_t first, index_t last, index_t final, bool with_axes,
                        extremes_t found, sight_t *sight) {
    double instants[BLOCK], duration = motion.breaks.v[motion.breaks.n - 1];
    block_t block = {.has_rates = true};
    index_t read = first - (first == 0 && motion.is_held[0] ? HISTORY : 0);
    index_t end = last + 1 + (last == final && motion.is_held[1] ? HISTORY : 0);
    while (read < end) {
        index_t known = block.count, more = least(BLOCK - known, end - read);
        for (index_t i = 0; i < more; i++) {
            index_t record = least(most(read + i, first), last);
            instants[i] = fmin(motion.period * (double)record, duration);
        }
        sample_trajectory((row_t){instants, more}, motion.breaks, motion.pieces, INFINITY,
                          (matrix_t){block.rows[0] + known, 10, BLOCK});
        block.count += more;
        read += more;
        take_differences(&block, motion.period, 0, with_axes, 0, sight, found);
        keep_last(&block);
    }
}

/* Return by which factor a motion should take longer to just keep its limits. */
static double excess(const double *squares, double period, matrix_t limits, double tolerance,
                     const double more[2], bool is_smooth) {
    double shares[6] = {0.0}, unit = 1.0;
    for (index_t order = 0; order < 3; order++) {
        unit *= period;
        for (index_t row = order; row < 6; row += 3)
            for (index_t c = 0; c < 4; c++)
                shares[row] = fmax(shares[row], sqrt(squares[4 * row + c]) / unit
                                                / row_of(limits, order)[c]);
    }
    double turn = fmax(shares[3], shares[0] / tolerance);
    double bend = fmax(more[0] * shares[4], shares[1] / tolerance);
    double twist = fmax(more[1] * shares[5], shares[2] / tolerance);
    return fmax(fmax(turn, sqrt(bend)), is_smooth ? cbrt(twist) : sqrt(twist));
}

int look_at(indices_t ranges, look_t motion, matrix_t limits, double tolerance,
            const double more[2], bool is_smooth, double *factor) {
    double squares[24] = {0.0};
    int64_t places[12];
    bool with_axes = false;
    for (index_t i = 0; i < 12; i++)
        with_axes |= i % 4 && limits.v[i] < INFINITY;
    sight_t *sight = malloc(sizeof *sight);
    if (sight == NULL)
        return OUT_OF_MEMORY;
    index_t final = (index_t)nearbyint(motion.breaks.v[motion.breaks.n - 1] / motion.period);
    for (index_t i = 0; i < ranges.n; i += 2)
        see_records(motion, ranges.v[i], ranges.v[i + 1], final, with_axes,
                    (extremes_t){squares, places}, sight);
    free(sight);
    *factor = excess(squares, motion.period, limits, tolerance, more, is_smooth);
    return 0;
}
