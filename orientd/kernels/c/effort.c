/* The effort of a cumulative B-spline with its derivatives, node by node, so that no more than one
 * node's matrices are in memory.
 *
 * A span's velocity and acceleration are built factor by factor (Sommer et al., 2020): with v the
 * rotation vector of a factor, J its right Jacobian, R(v)^T = I - [v] J, u its spin and omega, alpha
 * what the factors before it amount to, seen after it,
 *
 *     omega' = omega + u,    d omega' / dw = value [omega] J + rate I,
 *     alpha' = alpha + [omega] u + curvature w,
 *     d alpha' / dw = value ([alpha] - [u] [omega]) J + rate [omega] + curvature I.
 */
#include <string.h>

#include "interpolation.h"
#include "rotation.h"

typedef struct { double v[3][3]; } mat_t;

INLINE mat_t cross_of(vec_t v) {
    return (mat_t){{{0.0, -v.z, v.y}, {v.z, 0.0, -v.x}, {-v.y, v.x, 0.0}}};
}

INLINE mat_t product_of(mat_t a, mat_t b) {
    mat_t c;
    for (index_t i = 0; i < 3; i++)
        for (index_t j = 0; j < 3; j++)
            c.v[i][j] = a.v[i][0] * b.v[0][j] + a.v[i][1] * b.v[1][j] + a.v[i][2] * b.v[2][j];
    return c;
}

/* p a + q b. */
INLINE mat_t sum_of(double p, mat_t a, double q, mat_t b) {
    for (index_t i = 0; i < 3; i++)
        for (index_t j = 0; j < 3; j++)
            a.v[i][j] = p * a.v[i][j] + q * b.v[i][j];
    return a;
}

INLINE mat_t with_diagonal(mat_t a, double x) {
    for (index_t i = 0; i < 3; i++)
        a.v[i][i] += x;
    return a;
}

INLINE vec_t applied(mat_t m, vec_t v) {
    return vec(m.v[0][0] * v.x + m.v[0][1] * v.y + m.v[0][2] * v.z,
               m.v[1][0] * v.x + m.v[1][1] * v.y + m.v[1][2] * v.z,
               m.v[2][0] * v.x + m.v[2][1] * v.y + m.v[2][2] * v.z);
}

/* J v = v - a [v] + b [v][v] of a rotation vector. */
INLINE mat_t right_jacobian(vec_t v) {
    double square = dot(v, v), a, b;
    jacobian_factors(square, &a, &b);
    double rest = 1.0 - b * square, x = v.x, y = v.y, z = v.z;
    return (mat_t){{{rest + b * x * x, b * x * y + a * z, b * x * z - a * y},
                    {b * x * y - a * z, rest + b * y * y, b * y * z + a * x},
                    {b * x * z + a * y, b * y * z - a * x, rest + b * z * z}}};
}

/* Velocity and torque of a node, and the derivatives of the torque by each increment. */
static vec_t node_torque(index_t factors, const double *const *w, const double (*basis)[3],
                         const mat_t *inertia, mat_t *derivatives) {
    mat_t backs[MOST_FACTORS], spins[MOST_FACTORS];
    mat_t by_omega[MOST_FACTORS], by_alpha[MOST_FACTORS];
    vec_t omega = {0.0, 0.0, 0.0}, alpha = {0.0, 0.0, 0.0};
    for (index_t j = 0; j < factors; j++) {
        double value = 2.0 * basis[j][0], rate = 2.0 * basis[j][1], curvature = 2.0 * basis[j][2];
        vec_t own = vec_at(w[j]), v = times(value, own), spin = times(rate, own);
        mat_t jacobian = right_jacobian(v);
        backs[j] = with_diagonal(sum_of(-1.0, product_of(cross_of(v), jacobian), 0.0, jacobian), 1.0);
        omega = applied(backs[j], omega), alpha = applied(backs[j], alpha);
        spins[j] = cross_of(spin);
        mat_t across = cross_of(omega);
        mat_t bent = sum_of(1.0, cross_of(alpha), -1.0, product_of(spins[j], across));
        by_omega[j] = with_diagonal(sum_of(value, product_of(across, jacobian), 0.0, across), rate);
        by_alpha[j] = with_diagonal(sum_of(value, product_of(bent, jacobian), rate, across), curvature);
        alpha = plus(alpha, plus(cross(omega, spin), times(curvature, own)));
        omega = plus(omega, spin);
    }
    mat_t ahead = with_diagonal((mat_t){0}, 1.0), bent = {0};
    vec_t torque = alpha;
    if (inertia) {
        vec_t momentum = applied(*inertia, omega);
        ahead = *inertia;
        bent = sum_of(1.0, product_of(cross_of(omega), *inertia), -1.0, cross_of(momentum));
        torque = plus(applied(*inertia, alpha), cross(omega, momentum));
    }
    for (index_t j = factors - 1; j >= 0; j--) {
        derivatives[j] = sum_of(1.0, product_of(ahead, by_alpha[j]), 1.0, product_of(bent, by_omega[j]));
        bent = product_of(sum_of(1.0, bent, -1.0, product_of(ahead, spins[j])), backs[j]);
        ahead = product_of(ahead, backs[j]);
    }
    return torque;
}

/* The telescoped product from one keyframe to the next; see equations_t, of any factors. */
static void put_bound(matrix_t increments, const int64_t *index, const double *share,
                      index_t factors, quat_t step, double *bound, double *missed) {
    quat_t after = quat(1.0, 0.0, 0.0, 0.0);
    for (index_t f = factors - 1; f >= 0; f--) {
        double c = share[f];
        vec_t turn = times(c, vec_at(row_of(increments, index[f])));
        mat_t jacobian = right_jacobian(times(2.0, turn));
        for (index_t k = 0; k < 3; k++) {
            vec_t column = vec(jacobian.v[0][k], jacobian.v[1][k], jacobian.v[2][k]);
            column = times(c, turned_back(after.w, vec(after.x, after.y, after.z), column));
            double *to = bound + 3 * f + k;
            to[0] = column.x, to[3 * factors] = column.y, to[6 * factors] = column.z;
        }
        after = multiplied(exponential(turn), after);
    }
    put_vec(missed, logarithm(relative(step, after)));
}

double linearise_effort(matrix_t increments, indices_t window, tensor_t weights, row_t roots,
                        matrix_t inertia, indices_t index, matrix_t share, matrix_t steps,
                        matrix_t gradient, tensor_t squares, tensor_t bound, matrix_t missed) {
    index_t spans = gradient.n, factors = weights.m, places = roots.n / spans, size = 3 * factors;
    mat_t of_body;
    if (inertia.n)
        memcpy(&of_body, inertia.v, sizeof of_body);
    double effort = 0.0;
    for (index_t span = 0; span < spans; span++) {
        const double *w[MOST_FACTORS];
        double *restrict slope = row_of(gradient, span);
        double *restrict square = squares.v + span * size * size;
        for (index_t j = 0; j < factors; j++)
            w[j] = row_of(increments, window.v[span * factors + j]);
        memset(slope, 0, sizeof *slope * (size_t)size);
        memset(square, 0, sizeof *square * (size_t)(size * size));
        for (index_t n = span * places; n < (span + 1) * places; n++) {
            double basis[MOST_FACTORS][3], rows[3][3 * MOST_FACTORS];
            mat_t derivatives[MOST_FACTORS];
            for (index_t d = 0; d < 3; d++)
                for (index_t j = 0; j < factors; j++)
                    basis[j][d] = weights.v[(d * factors + j) * roots.n + n];
            vec_t torque = node_torque(factors, w, basis, inertia.n ? &of_body : NULL, derivatives);
            double residual[3] = {torque.x, torque.y, torque.z};
            for (index_t i = 0; i < 3; i++) {
                for (index_t k = 0; k < size; k++)
                    rows[i][k] = roots.v[n] * derivatives[k / 3].v[i][k % 3];
                double missing = roots.v[n] * residual[i];
                effort += missing * missing;
                for (index_t k = 0; k < size; k++) {
                    slope[k] += missing * rows[i][k];
                    for (index_t m = k; m < size; m++)
                        square[k * size + m] += rows[i][k] * rows[i][m];
                }
            }
        }
        for (index_t k = 0; k < size; k++)
            for (index_t m = 0; m < k; m++)
                square[k * size + m] = square[m * size + k];
    }
    for (index_t row = 0; row < share.n; row++)
        put_bound(increments, index.v + row * share.m, row_of(share, row), share.m,
                  quat_at(row_of(steps, row)), bound.v + row * 9 * share.m, row_of(missed, row));
    return 0.5 * effort;
}
