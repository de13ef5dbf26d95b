/* Times at keyframes by powers of their distances, and down the slope; see knot_times.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "interpolation.h"
#include "knot_times.h"
#include "profile_search.h"
#include "sampling.h"
#include "timing.h"

#define GAP 0.03         /* share of the duration that the barrier may cost: alike for all tried */
#define AGAIN 0.03       /* to begin with from the profile of another path */
#define LEAVING 0.8      /* of a length L that the parameter goes while it leaves rest */
#define SLIGHT 1e-4      /* change of a share, for the slope */
#define STEP 0.15        /* of the logarithm of the share that counts most, to begin with */
#define LEAST_STEP 0.02
#define SHORTER 0.4
#define AT_ALL 1e-4      /* share of the duration that is worth another descent */

/* Shares of the time: powers of the angles. */
static const double powers[] = {1.0, 0.8, 0.6};
enum { POWERS = sizeof powers / sizeof *powers };

typedef struct {
    const knots_t *asked;
    index_t keyframes, known, spans, spots;
    double leaves[2];
    row_t times, breaks, widths, places, instants;
    matrix_t base, solved, samples, s;
    tensor_t values;
    profile_path_t path;
    rate_t rates[MOST_RATES];
    int rate_count;
    search_t search;
} trial_t;

/* x where the formula changes. */
static double place_of_break(const trial_t *t, index_t i) {
    double total = t->asked->total + 0.2 * (t->leaves[0] + t->leaves[1]);
    return i == 0 ? 0.0 : i == t->spans ? total : t->breaks.v[i] + 0.2 * t->leaves[0];
}

static void put_places(trial_t *t) {
    index_t pieces = t->asked->pieces, e = 0;
    double begin = 0.0;
    for (index_t i = 0; i < t->spans; i++) {
        double end = place_of_break(t, i + 1), width = (end - begin) / (double)pieces;
        for (index_t k = 0; k < pieces; k++, e++) {
            t->widths.v[e] = width;
            t->places.v[2 * e] = begin + width * (double)k;
            t->places.v[2 * e + 1] = begin + width * ((double)k + 0.5);
        }
        begin = end;
    }
    t->places.v[2 * e] = begin;
}

/* Write angular velocity and acceleration at increasing instants, shape (6, n). */
static void sample(const trial_t *t, row_t instants, matrix_t out) {
    product_t product = {t->breaks, t->base, {NULL, 0}, t->solved, t->values};
    const double *breaks = t->breaks.v;
    index_t span = 0, count;
    for (index_t i = 0; i < instants.n; i += count) {
        double u[LANES];
        motions_t at;
        while (span + 2 < t->breaks.n && breaks[span + 1] <= instants.v[i])
            span++;
        double inverse = 1.0 / (breaks[span + 1] - breaks[span]);
        bool is_last = span + 2 == t->breaks.n;
        for (count = 0; count < least(LANES, instants.n - i); count++) {
            if (!is_last && !(instants.v[i + count] < breaks[span + 1]))
                break;
            u[count] = (instants.v[i + count] - breaks[span]) * inverse;
        }
        for (index_t k = count; k < LANES; k++)
            u[k] = u[0];
        product_at(&product, span, u, &at);
        for (index_t k = 0; k < 3; k++)
            for (index_t j = 0; j < count; j++) {
                row_of(out, k)[i + j] = at.omega[k][j];
                row_of(out, 3 + k)[i + j] = at.alpha[k][j];
            }
    }
}

/* Make the curve through the keyframes at some times, and what a profile needs of it. */
static int put_geometry(trial_t *t) {
    double nothing[12] = {0.0}, ends[2] = {0.0, t->asked->total}, rates[12];
    tensor_t given = {nothing, 2, 2, 3};
    interpolation_t curve = {.keys = t->asked->keys, .times = t->times, .order = 4,
                             .given = given, .known = {t->known, t->known}};
    int found = interpolate(&curve, t->breaks, t->base, t->solved, t->values);
    if (found != FOUND)
        return found;
    sample(t, (row_t){ends, 2}, (matrix_t){rates, 6, 2});
    bool has_jerk = false;
    for (index_t k = 0; k < 4; k++)
        has_jerk |= row_of(t->asked->limits, 2)[k] < INFINITY;
    for (index_t end = 0; end < 2; end++) {
        bool turns = rates[6 + end] != 0.0 || rates[8 + end] != 0.0 || rates[10 + end] != 0.0;
        index_t i = end ? t->keyframes - 2 : 0;
        t->leaves[end] = has_jerk && turns && t->known == 1
                             ? (t->times.v[i + 1] - t->times.v[i]) / LEAVING : 0.0;
    }
    put_places(t);
    double total = t->places.v[t->spots - 1];
    leave_rest(t->places, (row_t){t->leaves, 2}, total, t->s);
    for (index_t i = 0; i < t->spots; i++)
        t->instants.v[i] = fmin(fmax(row_of(t->s, 0)[i], 0.0), t->asked->total);
    sample(t, t->instants, t->samples);
    for (index_t i = 0; i < t->spots; i++) {
        double slope = row_of(t->s, 1)[i], bend = row_of(t->s, 2)[i];
        for (index_t k = 0; k < 3; k++) {
            double omega = row_of(t->samples, k)[i], alpha = row_of(t->samples, 3 + k)[i];
            row_of(t->path.first, i)[k] = omega * slope;
            row_of(t->path.second, i)[k] = alpha * slope * slope + omega * bend;
        }
    }
    put_path(&t->search, t->rates, t->rate_count);
    return FOUND;
}

static void share_out(trial_t *t, const double *shares) {
    double sum = 0.0, reached = 0.0;
    index_t last = t->keyframes - 1;
    for (index_t i = 0; i < last; i++)
        sum += shares[i];
    for (index_t i = 0; i < last; i++) {
        t->times.v[i] = t->asked->total * (reached / sum);
        reached += shares[i];
    }
    t->times.v[last] = t->asked->total;
}

/* Return the largest squared length of some vectors. */
static double largest_of(matrix_t rows) {
    double largest = 0.0;
    for (index_t i = 0; i < rows.n; i++) {
        const double *v = row_of(rows, i);
        largest = fmax(largest, v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    }
    return largest;
}

/* Return the squared rate at which half of some limit is used, and no other all of it. */
static double level_of(const trial_t *t) {
    double jerk = 0.0, level = INFINITY, least_of[3];
    for (index_t i = 0; i + 1 < t->spots; i++) {
        const double *here = row_of(t->path.second, i), *next = here + 3;
        double x = next[0] - here[0], y = next[1] - here[1], z = next[2] - here[2];
        double width = 0.5 * t->widths.v[i / 2];
        jerk = fmax(jerk, (x * x + y * y + z * z) / (width * width));
    }
    double sizes[3] = {sqrt(largest_of(t->path.first)), sqrt(largest_of(t->path.second)),
                       sqrt(jerk)};
    for (int order = 0; order < 3; order++) {
        const double *limits = row_of(t->asked->limits, order);
        least_of[order] = fmin(fmin(limits[0], limits[1]), fmin(limits[2], limits[3]));
        double share = least_of[order] / sizes[order];
        if (share < INFINITY)
            level = fmin(level, order == 0 ? share * share : order == 1 ? share : pow(share, 2.0 / 3));
    }
    return level < INFINITY ? 0.5 * level : 1.0;
}

/* Return the duration with the given shares, or infinity if no profile exists. */
static double duration_with(trial_t *t, const double *shares, double *c, bool is_first) {
    share_out(t, shares);
    if (put_geometry(t) != FOUND)
        return INFINITY;
    if (is_first) {
        double level = level_of(t);
        for (index_t i = 0; i < t->search.n + 2; i++)
            c[i] = level;
    }
    if (improve(&t->search, is_first ? 1.0 : AGAIN, GAP, c) != PROFILE_FOUND)
        return INFINITY;
    double found = duration(&t->search);
    return found > 0.0 ? found : INFINITY;
}

/* Write how the duration changes with the logarithms of the shares; return the largest change. */
static double put_slope(trial_t *t, double *shares, const double *c, double *slope) {
    double weight = t->search.weight, size = 0.0, here;
    index_t count = t->keyframes - 1;
    share_out(t, shares);
    if (put_geometry(t) != FOUND)
        return 0.0;
    spread(&t->search, c);
    here = cost_of(&t->search, weight, 1.0);
    for (index_t i = 0; i < count; i++) {
        double known = shares[i];
        slope[i] = 0.0;
        for (int side = 1; side >= -1; side -= 2) {
            shares[i] = known * exp(side * SLIGHT);
            share_out(t, shares);
            if (put_geometry(t) != FOUND)
                continue;
            spread(&t->search, c);
            double there = cost_of(&t->search, weight, 1.0);
            if (isfinite(there - here)) {
                slope[i] = side * (there - here) / SLIGHT;
                break;
            }
        }
        shares[i] = known;
        size = fmax(size, fabs(slope[i]));
    }
    return size;
}

/* Allocate memory for curves with 1 or 2 conditions at each end, and for the search. */
static bool new_trial(trial_t *t, const knots_t *asked, index_t known, double **own) {
    index_t n = asked->keys.n, spans = n - 1 + 2 * (known == 2), elements = spans * asked->pieces;
    index_t spots = 2 * elements + 1;
    index_t room = n + spans + 1 + elements + 2 * spots + 16 * spans + 3 * (spans + 2)
                 + 15 * spots + 3 * elements + 3 * (n - 1) + 2 * (elements + 2);
    double *next = malloc((size_t)room * sizeof(double));
    *own = next;
    *t = (trial_t){.asked = asked, .keyframes = n, .known = known, .spans = spans, .spots = spots};
    if (next == NULL)
        return false;
    t->times = (row_t){next, n}, next += n;
    t->breaks = (row_t){next, spans + 1}, next += spans + 1;
    t->widths = (row_t){next, elements}, next += elements;
    t->places = (row_t){next, spots}, next += spots;
    t->instants = (row_t){next, spots}, next += spots;
    t->solved = (matrix_t){next, spans + 2, 3}, next += 3 * (spans + 2);
    t->base = (matrix_t){next, spans, 4}, next += 4 * spans;
    t->values = (tensor_t){next, spans, 3, 4}, next += 12 * spans;
    t->samples = (matrix_t){next, 6, spots}, next += 6 * spots;
    t->s = (matrix_t){next, 3, spots}, next += 3 * spots;
    t->path.widths = t->widths;
    t->path.first = (matrix_t){next, spots, 3}, next += 3 * spots;
    t->path.second = (matrix_t){next, spots, 3}, next += 3 * spots;
    t->path.limits = asked->limits;
    t->path.aims = (matrix_t){next, 3, elements}, next += 3 * elements;
    for (index_t i = 0; i < 3 * elements; i++)
        t->path.aims.v[i] = 1.0;
    t->rate_count = put_limited(&t->path, t->rates);
    return new_search(&t->search, &t->path, t->rates, t->rate_count);
}

static void free_trial(trial_t *t, double *own) {
    free_search(&t->search);
    free(own);
}

/* Go down the slope from the best shares known, and return the duration there. */
static double descend(trial_t *t, double best, double *shares, double *slope, double *tried,
                      double *c, double *trial_c) {
    index_t count = t->keyframes - 1;
    size_t size = (size_t)(t->search.n + 2) * sizeof *c;
    double steepest = put_slope(t, shares, c, slope);
    if (!(steepest > 0.0))
        return best;
    for (double step = STEP; step >= LEAST_STEP; step *= SHORTER) {
        for (index_t i = 0; i < count; i++)
            tried[i] = shares[i] * exp(-step * slope[i] / steepest);
        memcpy(trial_c, c, size);
        double found = duration_with(t, tried, trial_c, false);
        if (found < best) {
            best = found;
            memcpy(shares, tried, (size_t)count * sizeof *shares);
            memcpy(c, trial_c, size);
            break;
        }
    }
    return best;
}

/* Write the duration on the curve of an even pace, whose ends have no acceleration. */
static bool put_plain_duration(const knots_t *asked, double *found) {
    trial_t t;
    double *own;
    bool is_there = new_trial(&t, asked, 2, &own);
    if (is_there) {
        double *c = t.path.aims.v + 3 * t.search.n + 3 * (asked->keys.n - 1);
        *found = duration_with(&t, asked->lengths.v, c, true);
    }
    free_trial(&t, own);
    return is_there;
}

int choose_knots(knots_t asked, row_t times, matrix_t profile) {
    trial_t t;
    double *own, plain = INFINITY;
    if (asked.descents && !put_plain_duration(&asked, &plain))
        return OUT_OF_MEMORY;
    if (!new_trial(&t, &asked, 1, &own)) {
        free_trial(&t, own);
        return OUT_OF_MEMORY;
    }
    index_t count = asked.keys.n - 1, size = t.search.n + 2;
    double *best_shares = t.path.aims.v + 3 * t.search.n, *tried = best_shares + count;
    double *slope = tried + count, *c = slope + count, *trial_c = c + size, best = INFINITY;
    for (int p = 0; p < (asked.descents ? POWERS : POWERS - 1); p++) {
        for (index_t i = 0; i < count; i++)
            tried[i] = pow(asked.lengths.v[i], powers[p]);
        bool is_first = !isfinite(best);
        if (!is_first)
            memcpy(trial_c, c, (size_t)size * sizeof *c);
        double found = duration_with(&t, tried, trial_c, is_first);
        if (!(found < best))
            break;
        best = found;
        memcpy(best_shares, tried, (size_t)count * sizeof *tried);
        memcpy(c, trial_c, (size_t)size * sizeof *c);
    }
    for (index_t k = 0; k < asked.descents && isfinite(best); k++) {
        double before = best;
        best = descend(&t, best, best_shares, slope, tried, c, trial_c);
        if (best > (1.0 - AT_ALL) * before)
            break;
    }
    bool is_better = best < plain && isfinite(best);
    if (is_better) {
        share_out(&t, best_shares);
        is_better = put_geometry(&t) == FOUND;
        spread(&t.search, c);
        put_shares(&t.path, t.search.value, t.search.slope,
                   (matrix_t){row_of(profile, SHARES), 3, profile.m});
        memcpy(times.v, t.times.v, (size_t)times.n * sizeof(double));
        memcpy(row_of(profile, COEFFICIENTS), c, (size_t)size * sizeof *c);
    }
    free_trial(&t, own);
    return is_better ? FOUND : NOT_FOUND;
}
