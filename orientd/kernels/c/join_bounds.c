/* Whether joins keep their bounds, at points spread evenly over them. */
#include "connectors.h"

/* Of the limit, for peaks between the points that are looked at. */
#define VELOCITY_MARGIN 0.9999
/* Ramps go right up to the bounds: rounding must not decide which of them keep them. */
#define ROUNDING 1e-9

enum { FINE = 49, FINE_LANES = 56 };  /* points of a join; lanes repeat the last one */

/* Basis functions of the joins with two derivatives, at evenly spaced points. */
typedef struct { double fine[3][FACTORS][FINE_LANES]; } points_t;

static void put_points(points_t *points) {
    for (int p = 0; p < FINE_LANES; p++) {
        basis_t at = join_basis(least(p, FINE - 1) / (double)(FINE - 1));
        for (int k = 0; k < FACTORS; k++) {
            points->fine[0][k][p] = at.value[k];
            points->fine[1][k][p] = at.rate[k];
            points->fine[2][k][p] = at.curvature[k];
        }
    }
}

bounds_t bounds_of(const motion_t *start, const motion_t *end, matrix_t limits) {
    bounds_t bounds;
    for (int order = 0; order < 3; order++)
        for (int k = 0; k < 4; k++)
            bounds.most[order][k] = row_of(limits, order)[k] * (order ? 1.0 : VELOCITY_MARGIN);
    vec_t has[2][2] = {{start->omega, end->omega}, {start->alpha, end->alpha}};
    for (int order = 0; order < 2; order++)
        for (int i = 0; i < 2; i++)
            for (int k = 0; k < 4; k++)
                bounds.most[order][k] = fmax(bounds.most[order][k], size_of(has[order][i], k));
    for (int order = 0; order < 3; order++)
        for (int k = 0; k < 4; k++)
            bounds.most[order][k] *= 1.0 + ROUNDING;
    return bounds;
}

INLINE int above(double square, vec_t v, double scale, const double most[4]) {
    return !(sqrt(square) * scale <= most[0]) | !(fabs(v.x) * scale <= most[1])
         | !(fabs(v.y) * scale <= most[2]) | !(fabs(v.z) * scale <= most[3]);
}

/* The largest of some values, by a parabola where it lies between them. */
static double peak(const double *squares, int count) {
    int at = 0;
    for (int i = 1; i < count; i++)
        if (squares[i] > squares[at])
            at = i;
    double largest = squares[at];
    at = at < 1 ? 1 : at > count - 2 ? count - 2 : at;
    double before = squares[at - 1], here = squares[at], after = squares[at + 1];
    double bend = 2.0 * here - before - after;
    if (here >= before && here >= after && bend > 0.0)
        return fmax(largest, here + (after - before) * (after - before) / (8.0 * bend));
    return largest;
}

static bool keeps(const vec_t w[FACTORS], double duration, const points_t *points,
           const bounds_t *bounds) {
    enum { LANES = 8 };
    join_t join = join_of(w, duration);
    double squares[3][FINE_LANES], bent[3][1 + FINE_LANES];
    double per_point = (FINE - 1) * join.per_second;
    for (int begin = 0; begin < FINE_LANES; begin += LANES) {
        int is_above = 0;
        INDEPENDENT
        for (int p = begin; p < begin + LANES; p++) {
            basis_t at;
#define TAKE_BASIS(K) \
            at.value[K] = points->fine[0][K][p], at.rate[K] = points->fine[1][K][p], \
            at.curvature[K] = points->fine[2][K][p]
            TAKE_BASIS(0);
            TAKE_BASIS(1);
            TAKE_BASIS(2);
            TAKE_BASIS(3);
            TAKE_BASIS(4);
#undef TAKE_BASIS
            motion_t here = join_at(quat(1.0, 0.0, 0.0, 0.0), &join, at);
            squares[0][p] = dot(here.omega, here.omega);
            squares[1][p] = dot(here.alpha, here.alpha);
            bent[0][1 + p] = here.alpha.x, bent[1][1 + p] = here.alpha.y;
            bent[2][1 + p] = here.alpha.z;
            is_above |= above(squares[0][p], here.omega, 1.0, bounds->most[0])
                      | above(squares[1][p], here.alpha, 1.0, bounds->most[1]);
        }
        if (is_above)
            return false;
        if (!begin)  /* no jerk at the first point */
            bent[0][0] = bent[0][1], bent[1][0] = bent[1][1], bent[2][0] = bent[2][1];
        for (int p = begin; p < begin + LANES; p++) {
            vec_t jerk = vec(bent[0][1 + p] - bent[0][p], bent[1][1 + p] - bent[1][p],
                             bent[2][1 + p] - bent[2][p]);
            jerk = times(per_point, jerk);
            squares[2][p] = dot(jerk, jerk);
            is_above |= above(squares[2][p], jerk, 1.0, bounds->most[2]);
        }
        if (is_above)
            return false;
    }
    return sqrt(peak(squares[0], FINE)) <= bounds->most[0][0]
        && sqrt(peak(squares[1], FINE)) <= bounds->most[1][0]
        && sqrt(peak(squares[2] + 1, FINE - 1)) <= bounds->most[2][0];
}

void try_joins(matrix_t first, matrix_t last, row_t durations, row_t around, matrix_t limits,
               tensor_t w, indices_t kept) {
    motion_t allowed = state_at(around.v);
    bounds_t bounds = bounds_of(&allowed, &allowed, limits);
    points_t points;
    put_points(&points);
    for (index_t i = 0; i < durations.n; i++) {
        motion_t start = state_at(row_of(first, i)), end = state_at(row_of(last, i));
        vec_t of[FACTORS];
        put_increments(&start, &end, durations.v[i], of);
        for (int k = 0; k < FACTORS; k++)
            put_vec(w.v + (i * FACTORS + k) * 3, of[k]);
        kept.v[i] = keeps(of, durations.v[i], &points, &bounds);
    }
}
