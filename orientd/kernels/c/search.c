/* The increments of an interpolating cumulative B-spline: Newton's method and one homotopy.
 *
 * For small steps, Newton's method starts from the spline of Euclidean space.  For large ones, the
 * search scales the steps and end conditions from zero to their full size.  It follows the solution
 * by its length, so the solution may fold back (Keller, 1977, pseudo-arclength continuation).  The
 * solution is then the one connected with small rotations.  If the homotopy does not arrive, Newton's
 * method with step control searches near the spline of Euclidean space.
 */
#include <stdlib.h>
#include <string.h>

#include "increments.h"

enum {
    MOST_STEPS = 30,       /* of Newton's method alone */
    MOST_CORRECTIONS = 6000, /* on the way: more than searches take that arrive */
    MOST_DESCENTS = 300,
};

/* Longer increments of Euclidean space, in rad of half angle, are too far away to begin with. */
static const double LONGEST_FIRST = 1.8;
/* The first correction must not be longer, and each must be a share of the one before it. */
static const double LARGEST_FIRST = 1.2, CONTRACTION = 0.6;
static const double LARGEST_GUESS_ERROR = 0.4, WAY_CONTRACTION = 0.3;
/* How small a correction has to be before the full scale is reached. */
static const double ON_THE_WAY = 3e-3;
/* After a correction so small the next one, its square, is lost in rounding. */
static const double SETTLED = 1e-8, ROUNDING = 1e-7;
static const double SMALLEST_LENGTH = 1e-6, SMALLEST_SHARE = 1e-6;

static void add(double *restrict to, double share, const double *restrict v, index_t n) {
    for (index_t i = 0; i < n; i++)
        to[i] += share * v[i];
}

static double product(const double *restrict a, const double *restrict b, index_t n) {
    double total = 0.0;
    for (index_t i = 0; i < n; i++)
        total += a[i] * b[i];
    return total;
}

static double largest(const double *v, index_t n) {
    double found = 0.0;
    for (index_t i = 0; i < n; i++)
        found = fmax(found, fabs(v[i]));
    return found;
}

/* Improve the increments at full scale until only rounding is left; return whether they settle. */
static bool settle(system_t *system, double limit) {
    index_t n = 3 * system->count;
    double before = INFINITY;
    for (index_t step = 0; step < MOST_STEPS; step++) {
        double size = correct(system, 1.0);
        if (!(size <= limit))
            return false;
        add(system->w, 1.0, system->change, n);
        if (size <= SETTLED || (size <= ROUNDING && size > 0.5 * before))
            return true;
        limit = fmax(CONTRACTION * size, ROUNDING);
        before = size;
    }
    return false;
}

/* A point on the way and the direction that it was left in. */
typedef struct { double scale, unit, weight, *w, *tangent; index_t left; } way_t;

/* Bring the increments back to the way, in the plane across its direction, or at full scale;
 * return whether they were near.  The system's rate is that of the way then. */
static bool approach(system_t *system, way_t *way, double *scale, bool is_last) {
    index_t n = 3 * system->count;
    double limit = LARGEST_GUESS_ERROR;
    while (way->left-- > 0) {
        double size = correct(system, *scale), change = 0.0;
        if (!is_last) {
            double slope = product(way->tangent, system->rate, n) + way->weight * way->unit;
            change = -product(way->tangent, system->change, n) / slope;
            add(system->change, change, system->rate, n);
            size = fmax(largest(system->change, n), sqrt(way->weight) * fabs(change)) + 0.0 * size;
        }
        if (!(size <= limit))
            return false;
        add(system->w, 1.0, system->change, n);
        *scale += change;
        if (size <= ON_THE_WAY)
            return true;
        limit = fmax(WAY_CONTRACTION * size, ON_THE_WAY);
    }
    return false;
}

/* Follow the solution from scale zero to the full scale; return whether it arrives. */
static bool follow(system_t *system, way_t *way) {
    index_t n = 3 * system->count;
    double sense = 1.0, length = 0.0;
    memset(system->w, 0, (size_t)n * sizeof *system->w);
    correct(system, 0.0);
    way->scale = 0.0, way->weight = 0.0;
    for (index_t i = 0; i < system->rows; i++)
        way->weight = fmax(way->weight, system->step[i] * system->step[i]);
    way->weight = fmax(way->weight, 1e-6);
    while (way->left > 0) {
        double size = fmax(largest(system->rate, n), sqrt(way->weight));
        memcpy(way->w, system->w, (size_t)n * sizeof *way->w);
        memcpy(way->tangent, system->rate, (size_t)n * sizeof *way->tangent);
        way->unit = sense / size;
        for (index_t i = 0; i < n; i++)
            way->tangent[i] *= way->unit;
        length = length > 0.0 ? length : 0.5 * size;
        double ahead;
        for (;;) {
            ahead = way->scale + length * way->unit;
            bool is_last = ahead >= 1.0 && way->unit > 0.0;
            if (is_last)
                ahead = 1.0, length = (1.0 - way->scale) / way->unit;
            memcpy(system->w, way->w, (size_t)n * sizeof *way->w);
            add(system->w, length, way->tangent, n);
            bool is_near = approach(system, way, &ahead, is_last);
            if (is_near && is_last && settle(system, LARGEST_GUESS_ERROR))
                return true;
            if (is_near && ahead < 1.0)
                break;
            length *= 0.5;
            if (length < SMALLEST_LENGTH || way->left <= 0)
                return false;
        }
        /* The homotopy keeps its direction. */
        double along = (ahead - way->scale) * way->weight;
        for (index_t i = 0; i < n; i++)
            along += system->rate[i] * (system->w[i] - way->w[i]);
        sense = along < 0.0 ? -1.0 : 1.0;
        way->scale = ahead;
        length *= 2.0;
    }
    return false;
}

/* Newton's method with step control from the increments of Euclidean space. */
static bool descend(system_t *system, double *here) {
    index_t n = 3 * system->count;
    memset(system->w, 0, (size_t)n * sizeof *system->w);
    correct(system, 0.0);
    memcpy(system->w, system->rate, (size_t)n * sizeof *here);
    double size = correct(system, 1.0);
    double *step = here + n;
    for (index_t round = 0; round < MOST_DESCENTS && size < INFINITY; round++) {
        double error = system->error, share = 1.0, before = size;
        memcpy(here, system->w, (size_t)n * sizeof *here);
        memcpy(step, system->change, (size_t)n * sizeof *here);
        for (;; share *= 0.5) {
            if (share < SMALLEST_SHARE)
                return false;
            memcpy(system->w, here, (size_t)n * sizeof *here);
            add(system->w, share, step, n);
            size = correct(system, 1.0);
            if (system->error <= (1.0 - 0.1 * share) * error || system->error < ROUNDING * ROUNDING)
                break;
        }
        if (share == 1.0 && before <= ROUNDING)
            return settle(system, LARGEST_GUESS_ERROR);
    }
    return false;
}

int solve_increments(system_t *system) {
    index_t n = 3 * system->count;
    correct(system, 0.0); /* from increments of zero the rate is the spline of Euclidean space */
    memcpy(system->w, system->rate, (size_t)n * sizeof *system->w);
    bool is_far = false;
    for (index_t i = 0; i < system->count; i++)
        is_far |= norm(vec_at(system->w + 3 * i)) > LONGEST_FIRST;
    if (!is_far && settle(system, LARGEST_FIRST))
        return FOUND;
    double *memory = malloc(2 * (size_t)n * sizeof *memory);
    if (!memory)
        return OUT_OF_MEMORY;
    way_t way = {.w = memory, .tangent = memory + n, .left = MOST_CORRECTIONS};
    bool is_found = follow(system, &way) || descend(system, memory);
    free(memory);
    return is_found ? FOUND : NOT_FOUND;
}

int settle_increments(system_t *system) {
    return settle(system, LARGEST_FIRST) ? FOUND : NOT_FOUND;
}
