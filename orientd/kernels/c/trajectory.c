/* Fit and sample tables of pieces; see trajectory.h.
 *
 * With c = r x r', A = r x c and x = |r|^2,
 *
 *     omega = r' - a c + b A,     a = (1 - cos |r|) / x,     b = (|r| - sin |r|) / |r|^3
 *
 * and its derivatives follow by the product rule: c' = r x r'', A' = r' x c + r x c', and so on.
 * Every factor is an entire function of x.  Its polynomial interpolates at the Chebyshev nodes of
 * [0, 1.21], to 5e-17 of its value, so no sample takes a branch, a root, a sine or a division.
 */
#include "trajectory.h"

#include <math.h>
#include <string.h>

enum {
    FEW = 8,   /* shorter runs of instants are padded to so many */
    ALONE = 2,   /* runs up to so many instants go into a tile */
    TILE = 64,
    STRIDE = 64, /* instants that are looked at together for whether they are in a piece */
    MOST_ROWS = 13,
};

/* Chebyshev coefficients of the polynomial of degree 9 by its values at the Lobatto nodes. */
static const double CHEBYSHEV[NODES][NODES] = {
    {0.05555555555555555, 0.1111111111111111, 0.1111111111111111, 0.1111111111111111,
     0.1111111111111111, 0.1111111111111111, 0.1111111111111111, 0.1111111111111111,
     0.1111111111111111, 0.05555555555555555},
    {-0.1111111111111111, -0.20882058239686854, -0.170232098470884, -0.1111111111111111,
     -0.038588483925984525, 0.038588483925984525, 0.1111111111111111, 0.170232098470884,
     0.20882058239686854, 0.1111111111111111},
    {0.1111111111111111, 0.170232098470884, 0.038588483925984525, -0.1111111111111111,
     -0.20882058239686854, -0.20882058239686854, -0.1111111111111111, 0.038588483925984525,
     0.170232098470884, 0.1111111111111111},
    {-0.1111111111111111, -0.1111111111111111, 0.1111111111111111, 0.2222222222222222,
     0.1111111111111111, -0.1111111111111111, -0.2222222222222222, -0.1111111111111111,
     0.1111111111111111, 0.1111111111111111},
    {0.1111111111111111, 0.038588483925984525, -0.20882058239686854, -0.1111111111111111,
     0.170232098470884, 0.170232098470884, -0.1111111111111111, -0.20882058239686854,
     0.038588483925984525, 0.1111111111111111},
    {-0.1111111111111111, 0.038588483925984525, 0.20882058239686854, -0.1111111111111111,
     -0.170232098470884, 0.170232098470884, 0.1111111111111111, -0.20882058239686854,
     -0.038588483925984525, 0.1111111111111111},
    {0.1111111111111111, -0.1111111111111111, -0.1111111111111111, 0.2222222222222222,
     -0.1111111111111111, -0.1111111111111111, 0.2222222222222222, -0.1111111111111111,
     -0.1111111111111111, 0.1111111111111111},
    {-0.1111111111111111, 0.170232098470884, -0.038588483925984525, -0.1111111111111111,
     0.20882058239686854, -0.20882058239686854, 0.1111111111111111, 0.038588483925984525,
     -0.170232098470884, 0.1111111111111111},
    {0.1111111111111111, -0.20882058239686854, 0.170232098470884, -0.1111111111111111,
     0.038588483925984525, 0.038588483925984525, -0.1111111111111111, 0.170232098470884,
     -0.20882058239686854, 0.1111111111111111},
    {-0.05555555555555555, 0.1111111111111111, -0.1111111111111111, 0.1111111111111111,
     -0.1111111111111111, 0.1111111111111111, -0.1111111111111111, 0.1111111111111111,
     -0.1111111111111111, 0.05555555555555555},
};

/* Rad, below which the last Chebyshev coefficients are rounding, which derivatives would enlarge. */
#define NEGLIGIBLE 2.5e-16

typedef struct { double f0, f1, f2, f3, f4, f5, f6; } factor_t;

INLINE double series(double x, factor_t f) {
    double high = fused(x, fused(x, f.f6, f.f5), f.f4);
    return fused(x, fused(x, fused(x, fused(x, high, f.f3), f.f2), f.f1), f.f0);
}

/* cos(|r| / 2) and sin(|r| / 2) / |r| */
static const factor_t COSINE = {1.0, -0.12499999999999997, 0.0026041666666663204,
    -2.1701388887172577e-05, 9.688119634320734e-08, -2.6910953001319e-10, 5.067293752679903e-13};
static const factor_t SINE = {0.5, -0.020833333333333332, 0.0002604166666666551,
    -1.5500992062919677e-06, 5.382288775750999e-09, -1.223231087797278e-11,
    1.9504724791137858e-14};
/* b, and the first and second derivatives of a and b by x; a = 2 (sin(|r| / 2) / |r|)^2. */
static const factor_t B = {0.16666666666666666, -0.00833333333333323, 0.00019841269841131952, -2.755731915558548e-06,
    2.505209222372056e-08, -1.6057082534450462e-10, 7.528989373648548e-13};
static const factor_t A_1 = {-0.041666666666666664, 0.0027777777777777315,
    -7.440476190414915e-05, 1.1022927659198658e-06, -1.0438371311948242e-08,
    6.881575777352552e-11, -3.2931171253821405e-13};
static const factor_t B_1 = {-0.008333333333333333, 0.0003968253968253944,
    -8.267195767163479e-06, 1.0020843338160742e-07, -8.029518134353167e-10,
    4.5878390709969364e-12, -1.9403595352111572e-14};
static const factor_t A_2 = {0.002777777777777778, -0.0001488095238095227, 3.306878306863779e-06,
    -4.175351390367231e-08, 3.4412219766686726e-10, -2.007173873023429e-12,
    8.622292107923939e-15};
static const factor_t B_2 = {0.0003968253968253968, -1.653439153439148e-05, 3.0062530062460814e-07,
    -3.2118087639294505e-09, 2.294148308032689e-11, -1.180713583810707e-13,
    4.544251457479621e-16};

/* A piece at one instant: u, how fast it changes, and the numbers of the piece, stride apart. */
typedef struct { double u, rate; const double *piece; index_t stride; } place_t;

/* Write one component of r and its derivatives by time, by Horner's scheme. */
INLINE void component(place_t at, int axis, bool with_jerk, double *r, double *first,
                      double *second, double *third) {
    const double *c = at.piece + (4 + axis) * at.stride;
    double p = c[3 * DEGREE * at.stride], p1 = 0.0, p2 = 0.0, p3 = 0.0;
    for (int j = DEGREE - 1; j >= 0; j--) {
        if (with_jerk)
            p3 = fused(p3, at.u, p2);
        p2 = fused(p2, at.u, p1);
        p1 = fused(p1, at.u, p);
        p = fused(p, at.u, c[3 * j * at.stride]);
    }
    *r = p;
    *first = p1 * at.rate;
    *second = 2.0 * p2 * at.rate * at.rate;
    *third = 6.0 * p3 * at.rate * at.rate * at.rate;
}

/* Write one sample, rows that are stride numbers apart. */
INLINE void put_sample(place_t at, int rows, double *restrict out, index_t stride) {
    vec_t r, r1, r2, r3;
    bool with_jerk = rows > 10;
    component(at, 0, with_jerk, &r.x, &r1.x, &r2.x, &r3.x);
    component(at, 1, with_jerk, &r.y, &r1.y, &r2.y, &r3.y);
    component(at, 2, with_jerk, &r.z, &r1.z, &r2.z, &r3.z);
    double x = dot(r, r), s = series(x, SINE), a = 2.0 * s * s, b = series(x, B);
    const double *base = at.piece;
    quat_t q = followed(quat(base[0], base[at.stride], base[2 * at.stride], base[3 * at.stride]),
                        series(x, COSINE), times(s, r));
    out[0] = q.w, out[stride] = q.x, out[2 * stride] = q.y, out[3 * stride] = q.z;
    if (rows == 4)
        return;
    vec_t c = cross(r, r1), twice = cross(r, c);
    vec_t omega = scaled_plus(b, twice, scaled_plus(-a, c, r1));
    vec_t c1 = cross(r, r2), twice1 = plus(cross(r1, c), cross(r, c1));
    double x1 = 2.0 * dot(r, r1), a_x = series(x, A_1), b_x = series(x, B_1);
    double a1 = a_x * x1, b1 = b_x * x1;
    vec_t alpha = scaled_plus(b, twice1, scaled_plus(b1, twice,
                  scaled_plus(-a, c1, scaled_plus(-a1, c, r2))));
    out[4 * stride] = omega.x, out[5 * stride] = omega.y, out[6 * stride] = omega.z;
    out[7 * stride] = alpha.x, out[8 * stride] = alpha.y, out[9 * stride] = alpha.z;
    if (rows == 10)
        return;
    vec_t c2 = plus(cross(r1, r2), cross(r, r3));
    vec_t twice2 = plus(plus(cross(r2, c), times(2.0, cross(r1, c1))), cross(r, c2));
    double x2 = 2.0 * (dot(r1, r1) + dot(r, r2));
    double a2 = fused(series(x, A_2), x1 * x1, a_x * x2);
    double b2 = fused(series(x, B_2), x1 * x1, b_x * x2);
    vec_t jerk = scaled_plus(-a2, c, scaled_plus(-2.0 * a1, c1, scaled_plus(-a, c2, r3)));
    jerk = scaled_plus(b2, twice, scaled_plus(2.0 * b1, twice1, scaled_plus(b, twice2, jerk)));
    out[10 * stride] = jerk.x, out[11 * stride] = jerk.y, out[12 * stride] = jerk.z;
}

INLINE place_t place_in(double t, double start, double end, const double *piece, index_t stride) {
    double rate = 2.0 / (end - start);
    return (place_t){fused(t - start, rate, -1.0), rate, piece, stride};
}

/* Write samples of instants inside one piece; whole is how many, a multiple of FEW or fewer. */
INLINE void fill_rows(const double *restrict instants, index_t whole, double start, double end,
                      const double *piece, int rows, double *restrict out, index_t stride) {
    INDEPENDENT
    for (index_t i = 0; i < whole; i++)
        put_sample(place_in(instants[i], start, end, piece, 1), rows, out + i, stride);
}

static void fill_piece(const double *instants, index_t whole, double start, double end,
                       const double *piece, index_t rows, double *out, index_t stride) {
    if (rows == 4)
        fill_rows(instants, whole, start, end, piece, 4, out, stride);
    else if (rows == 10)
        fill_rows(instants, whole, start, end, piece, 10, out, stride);
    else
        fill_rows(instants, whole, start, end, piece, MOST_ROWS, out, stride);
}

/* Write samples of fewer instants than a vector has lanes. */
static void fill_short(const double *instants, index_t count, double start, double end,
                       const double *piece, index_t rows, double *out, index_t stride) {
    double padded[FEW], samples[MOST_ROWS * FEW];
    for (index_t i = 0; i < FEW; i++)
        padded[i] = instants[least(i, count - 1)];
    fill_piece(padded, FEW, start, end, piece, rows, samples, FEW);
    for (index_t row = 0; row < rows; row++)
        for (index_t i = 0; i < count; i++)
            out[row * stride + i] = samples[row * FEW + i];
}

/* Instants in pieces of their own: u, rate and the numbers of the piece, and the samples. */
typedef struct {
    double u[TILE], rate[TILE], piece[PIECE][TILE], samples[MOST_ROWS][TILE];
    index_t held;
} tile_t;

INLINE void fill_tile_rows(tile_t *restrict tile, int rows) {
    INDEPENDENT
    for (index_t i = 0; i < TILE; i++) {
        place_t at = {tile->u[i], tile->rate[i], &tile->piece[0][i], TILE};
        put_sample(at, rows, &tile->samples[0][i], TILE);
    }
}

/* Work off a tile, the instants before end, and empty it. */
static void unload(tile_t *tile, index_t end, matrix_t out) {
    if (!tile->held)
        return;
    if (out.n == 4)
        fill_tile_rows(tile, 4);
    else if (out.n == 10)
        fill_tile_rows(tile, 10);
    else
        fill_tile_rows(tile, MOST_ROWS);
    for (index_t row = 0; row < out.n; row++)
        memcpy(row_of(out, row) + end - tile->held, tile->samples[row],
               (size_t)tile->held * sizeof(double));
    tile->held = 0;
}

INLINE void load(tile_t *tile, double t, double start, double end, const double *piece) {
    index_t i = tile->held++;
    place_t at = place_in(t, start, end, piece, 1);
    tile->u[i] = at.u, tile->rate[i] = at.rate;
    for (int number = 0; number < PIECE; number++)
        tile->piece[number][i] = piece[number];
}

/* Count how many of the next STRIDE instants are in a piece, in a loop without a break. */
INLINE index_t inside(const double *instants, double start, double end) {
    index_t found = 0;
    for (index_t i = 0; i < STRIDE; i++)
        found += (instants[i] >= start) & (instants[i] < end);
    return found;
}

/* How many instants are in a piece from the first one on, which is taken to be. */
INLINE index_t run_length(const double *instants, index_t count, double start, double end) {
    index_t stop = 1, few = least(count, FEW);
    while (stop < few && start <= instants[stop] && instants[stop] < end)
        stop++;
    if (stop < FEW)
        return stop;
    while (stop + STRIDE <= count && inside(instants + stop, start, end) == STRIDE)
        stop += STRIDE;
    while (stop < count && start <= instants[stop] && instants[stop] < end)
        stop++;
    return stop;
}

index_t sample_trajectory(row_t instants, row_t breaks, matrix_t pieces, double slack,
                          matrix_t out) {
    index_t piece = 0;
    double first = breaks.v[0], last = breaks.v[breaks.n - 1];
    tile_t tile;
    if (instants.n > ALONE)  /* places that are never loaded are worked off like the others */
        memset(&tile, 0, sizeof tile);
    tile.held = 0;
    for (index_t i = 0; i < instants.n;) {
        double t = instants.v[i], start = breaks.v[piece], end = breaks.v[piece + 1];
        if (!(start <= t && t < end)) {
            if (!(first - slack <= t && t <= last + slack))
                return i;
            t = fmin(fmax(t, first), last);
            if (piece + 2 < breaks.n && breaks.v[piece + 1] <= t && t < breaks.v[piece + 2])
                piece++;
            else
                piece = piece_of(t, breaks);
            start = breaks.v[piece], end = breaks.v[piece + 1];
        }
        const double *numbers = row_of(pieces, piece);
        index_t stop = i + run_length(instants.v + i, instants.n - i, start, end);
        if (t != instants.v[i]) {
            unload(&tile, i, out);
            fill_short(&t, 1, start, end, numbers, out.n, out.v + i, out.m);
            i++;
        } else if (stop - i > ALONE || instants.n <= ALONE) {
            unload(&tile, i, out);
            index_t whole = (stop - i) / FEW * FEW;
            fill_piece(instants.v + i, whole, start, end, numbers, out.n, out.v + i, out.m);
            i += whole;
            /* The next pieces overwrite the samples beyond the end of this piece. */
            if (i < stop && i + FEW <= instants.n)
                fill_piece(instants.v + i, FEW, start, end, numbers, out.n, out.v + i, out.m);
            else if (i < stop)
                fill_short(instants.v + i, stop - i, start, end, numbers, out.n, out.v + i, out.m);
            i = stop;
        } else {
            for (; i < stop; i++) {
                load(&tile, instants.v[i], start, end, numbers);
                if (tile.held == TILE)
                    unload(&tile, i + 1, out);
            }
        }
    }
    unload(&tile, instants.n, out);
    return -1;
}

/* The unit quaternion half way between two that are less than half a turn apart. */
INLINE quat_t middle_of(quat_t p, quat_t q) {
    quat_t sum = quat(p.w + q.w, p.x + q.x, p.y + q.y, p.z + q.z);
    double scale = 1.0 / sqrt(sum.w * sum.w + sum.x * sum.x + sum.y * sum.y + sum.z * sum.z);
    return quat(scale * sum.w, scale * sum.x, scale * sum.y, scale * sum.z);
}

/* How far a piece is from an orientation at u, rad. */
static double error_at(double u, const double *piece, quat_t q) {
    return norm(minus(polynomial_at(piece + 4, u), rotation_vector(quat_at(piece), q)));
}

void put_polynomial(const vec_t *r, double negligible, double *c) {
    vec_t low[NODES], high[NODES], sums[NODES];
    index_t degree = 0;
    for (int j = 0; j < NODES; j++) {
        vec_t sum = vec(0.0, 0.0, 0.0);
        for (int i = 0; i < NODES; i++)
            sum = scaled_plus(CHEBYSHEV[j][i], r[i], sum);
        sums[j] = sum;
        if (norm(sum) > negligible)
            degree = j;
    }
    /* Clenshaw's scheme, on polynomials: b_j = sums_j + 2 u b_j+1 - b_j+2. */
    memset(low, 0, sizeof low), memset(high, 0, sizeof high);
    for (index_t j = degree; j >= 0; j--) {
        double twice = j > 0 ? 2.0 : 1.0;
        vec_t carried = vec(0.0, 0.0, 0.0);
        for (index_t i = 0; i <= degree - j; i++) {
            vec_t next = minus(times(twice, carried), high[i]);
            carried = low[i], high[i] = low[i];
            low[i] = i > 0 ? next : plus(next, sums[j]);
        }
    }
    for (index_t i = 0; i < NODES; i++)
        put_vec(c + 3 * i, low[i]);
}

/* Of the twelve orientations of a piece: which are at the nodes, and which are between them. */
static const int AT_NODE[NODES] = {0, 1, 3, 4, 5, 6, 7, 9, 10, 11};
static const struct { int place; double u; } BETWEEN[] = {
    {2, -0.8660254037844387}, {8, 0.6427876096865394},
};

void fit_trajectory(tensor_t orientations, matrix_t pieces, matrix_t quality) {
    for (index_t k = 0; k < orientations.n; k++) {
        const double *given = orientations.v + k * INSTANTS * 4;
        double *piece = row_of(pieces, k), *found = row_of(quality, k);
        quat_t low = quat_at(given + 4 * AT_NODE[NODES / 2 - 1]);
        quat_t high = quat_at(given + 4 * AT_NODE[NODES / 2]), first = quat_at(given);
        quat_t base = middle_of(low, square_apart(low, high, 1.0) > 2.0 ? opposite(high) : high);
        base = square_apart(base, first, 1.0) > 2.0 ? opposite(base) : base;
        vec_t r[NODES];
        found[0] = found[1] = 0.0;
        for (int i = 0; i < NODES; i++) {
            r[i] = rotation_vector(base, quat_at(given + 4 * AT_NODE[i]));
            found[0] = fmax(found[0], norm(r[i]));
        }
        put_quat(piece, base);
        put_polynomial(r, NEGLIGIBLE, piece + 4);
        for (int i = 0; i < 2; i++)
            found[1] = fmax(found[1], error_at(BETWEEN[i].u, piece,
                                               quat_at(given + 4 * BETWEEN[i].place)));
    }
}
