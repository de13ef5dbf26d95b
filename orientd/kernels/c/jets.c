/* Second-order jets through products, exponentials, logarithms and slerps.
 *
 * With z = v . v both cos(sqrt z) and S = sin(sqrt z) / sqrt z are entire functions of z, with
 * cos' = -S/2, S' = (cos - S)/2z and S'' = -(S/2 + 3 S')/2z.  With c and s the scalar part and the
 * length of the vector part of a quaternion and f = atan2(s, c)/s the derivatives by c are
 * f' = (c f - 1)/s^2 and f'' = (f + 3 c f')/s^2.  Where these quotients cancel their series takes
 * over: of the first in z, of the other in y = 1 - c, f = sum n!/(2n + 1)!! y^n.
 */
#include "jets.h"

#include "rotation.h"

#define SMALL_SQUARE 0.5
#define SMALL_VERSINE 0.125

static const double sinc_series[] = {
    1.0, -1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880, -1.0 / 39916800, 1.0 / 6227020800.0,
    -1.0 / 1307674368000.0, 1.0 / 355687428096000.0, -1.0 / 121645100408832000.0,
};
static const double angle_over_sine_series[] = {
    1.0, 1.0 / 3, 2.0 / 15, 2.0 / 35, 8.0 / 315, 8.0 / 693, 16.0 / 3003, 16.0 / 6435,
    128.0 / 109395, 128.0 / 230945, 256.0 / 969969, 256.0 / 2028117, 1024.0 / 16900975,
    1024.0 / 35102025, 2048.0 / 145422675, 2048.0 / 300540195,
};

typedef struct { double value, first, second; } scalar_jet_t;
typedef struct { vec_t value, first, second; } vec_jet_t;
typedef struct { quat_t value, first, second; } quat_jet_t;

INLINE scalar_jet_t scalar_jet_at(jets_t jets, index_t i) {
    return (scalar_jet_t){jets.value[i], jets.first[i], jets.second[i]};
}
INLINE vec_jet_t vec_jet_at(jets_t jets, index_t i) {
    return (vec_jet_t){vec_at(jets.value + 3 * i), vec_at(jets.first + 3 * i),
                       vec_at(jets.second + 3 * i)};
}
INLINE quat_jet_t quat_jet_at(jets_t jets, index_t i) {
    return (quat_jet_t){quat_at(jets.value + 4 * i), quat_at(jets.first + 4 * i),
                        quat_at(jets.second + 4 * i)};
}
INLINE void put_vec_jet(jets_t jets, index_t i, vec_jet_t a) {
    put_vec(jets.value + 3 * i, a.value), put_vec(jets.first + 3 * i, a.first);
    put_vec(jets.second + 3 * i, a.second);
}
INLINE void put_quat_jet(jets_t jets, index_t i, quat_jet_t a) {
    put_quat(jets.value + 4 * i, a.value), put_quat(jets.first + 4 * i, a.first);
    put_quat(jets.second + 4 * i, a.second);
}

INLINE quat_t sum(quat_t p, double s, quat_t q) {
    return quat(fused(s, q.w, p.w), fused(s, q.x, p.x), fused(s, q.y, p.y), fused(s, q.z, p.z));
}

/* Leibniz' rule, with the order kept. */
INLINE quat_jet_t product(quat_jet_t p, quat_jet_t q) {
    quat_t outer = sum(multiplied(p.second, q.value), 1.0, multiplied(p.value, q.second));
    return (quat_jet_t){
        multiplied(p.value, q.value),
        sum(multiplied(p.first, q.value), 1.0, multiplied(p.value, q.first)),
        sum(outer, 2.0, multiplied(p.first, q.first)),
    };
}

INLINE quat_jet_t inverse(quat_jet_t q) {
    return (quat_jet_t){conjugated(q.value), conjugated(q.first), conjugated(q.second)};
}

INLINE vec_jet_t scaled(scalar_jet_t s, vec_jet_t v) {
    vec_t outer = scaled_plus(s.second, v.value, times(s.value, v.second));
    return (vec_jet_t){
        times(s.value, v.value),
        scaled_plus(s.first, v.value, times(s.value, v.first)),
        scaled_plus(2.0 * s.first, v.first, outer),
    };
}

/* A function by its value and derivatives where the jet is. */
INLINE scalar_jet_t composed(scalar_jet_t x, double value, double first, double second) {
    return (scalar_jet_t){value, first * x.first,
                          second * x.first * x.first + first * x.second};
}

/* A polynomial with its first two derivatives, by Horner's rule. */
INLINE void sum_up(const double *coefficients, int count, double x, double sums[3]) {
    double value = 0.0, first = 0.0, second = 0.0;
    for (int k = count - 1; k >= 0; k--) {
        second = second * x + first;
        first = first * x + value;
        value = value * x + coefficients[k];
    }
    sums[0] = value, sums[1] = first, sums[2] = 2.0 * second;
}

static quat_jet_t jet_exponential(vec_jet_t v) {
    scalar_jet_t z = {dot(v.value, v.value), 2.0 * dot(v.value, v.first),
                      2.0 * (dot(v.first, v.first) + dot(v.value, v.second))};
    double root = sqrt(z.value), cosine = cos(root), sinc[3];
    if (z.value < SMALL_SQUARE)
        sum_up(sinc_series, sizeof sinc_series / sizeof *sinc_series, z.value, sinc);
    else {
        sinc[0] = sin(root) / root;
        sinc[1] = (cosine - sinc[0]) / (2.0 * z.value);
        sinc[2] = -(0.5 * sinc[0] + 3.0 * sinc[1]) / (2.0 * z.value);
    }
    scalar_jet_t w = composed(z, cosine, -0.5 * sinc[0], -0.5 * sinc[1]);
    vec_jet_t e = scaled(composed(z, sinc[0], sinc[1], sinc[2]), v);
    return (quat_jet_t){
        quat(w.value, e.value.x, e.value.y, e.value.z),
        quat(w.first, e.first.x, e.first.y, e.first.z),
        quat(w.second, e.second.x, e.second.y, e.second.z),
    };
}

static vec_jet_t jet_logarithm(quat_jet_t q) {
    scalar_jet_t c = {q.value.w, q.first.w, q.second.w};
    vec_jet_t e = {
        vec(q.value.x, q.value.y, q.value.z),
        vec(q.first.x, q.first.y, q.first.z),
        vec(q.second.x, q.second.y, q.second.z),
    };
    double square = dot(e.value, e.value), f[3];
    double versine = c.value > 0.0 ? square / (1.0 + c.value) : 1.0;
    if (versine < SMALL_VERSINE) {
        sum_up(angle_over_sine_series,
               sizeof angle_over_sine_series / sizeof *angle_over_sine_series, versine, f);
        f[1] = -f[1];
    } else {
        double sine = sqrt(square);
        f[0] = atan2(sine, c.value) / sine;
        f[1] = (c.value * f[0] - 1.0) / square;
        f[2] = (f[0] + 3.0 * c.value * f[1]) / square;
    }
    return scaled(composed(c, f[0], f[1], f[2]), e);
}

void exponentials(index_t n, jets_t vectors, jets_t out) {
    for (index_t i = 0; i < n; i++)
        put_quat_jet(out, i, jet_exponential(vec_jet_at(vectors, i)));
}

void logarithms(index_t n, jets_t quaternions, jets_t out) {
    for (index_t i = 0; i < n; i++)
        put_vec_jet(out, i, jet_logarithm(quat_jet_at(quaternions, i)));
}

void slerps(index_t n, jets_t p, jets_t q, jets_t u, jets_t out) {
    for (index_t i = 0; i < n; i++) {
        quat_jet_t from = quat_jet_at(p, i);
        vec_jet_t step = jet_logarithm(product(inverse(from), quat_jet_at(q, i)));
        quat_jet_t turn = jet_exponential(scaled(scalar_jet_at(u, i), step));
        put_quat_jet(out, i, product(from, turn));
    }
}

/* A turn about a fixed axis, so q' = u' q w and q'' = u'' q w - u'^2 |w|^2 q. */
void geodesics(index_t n, const double *p, const double *w, jets_t u, jets_t out) {
    for (index_t i = 0; i < n; i++) {
        scalar_jet_t share = scalar_jet_at(u, i);
        vec_t step = vec_at(w + 3 * i);
        quat_t q = multiplied(quat_at(p + 4 * i), exponential(times(share.value, step)));
        quat_t along = multiplied(q, quat(0.0, step.x, step.y, step.z));
        quat_t none = {0}, bend = sum(none, share.second, along);
        put_quat_jet(out, i, (quat_jet_t){
            q, sum(none, share.first, along),
            sum(bend, -share.first * share.first * dot(step, step), q),
        });
    }
}
