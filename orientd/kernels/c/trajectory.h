/* A trajectory of orientations: a table of pieces, and what is done with it.
 *
 * On piece k, over [breaks_k, breaks_k+1] with u from -1 to 1 along it,
 *
 *     q(t) = q_k exp(r_k(u)),     r_k = c_0 + c_1 u + ... + c_9 u^9
 *
 * where r is a rotation vector in rad.  Body angular velocity, acceleration and jerk follow from r
 * and its derivatives by the right Jacobian of the exponential (Sola et al., 2018, eq. 143).
 */
#ifndef ORIENTD_TRAJECTORY_H
#define ORIENTD_TRAJECTORY_H

#include "arrays.h"
#include "clock.h"
#include "lane_log.h"
#include "sampling.h"

/* The longest rotation vector of a piece at its nodes, rad; the series reach to 1.1. */
#define LONGEST_TURN 1.0

enum {
    DEGREE = 9,
    NODES = DEGREE + 1,          /* orientations that a piece is fitted to */
    INSTANTS = NODES + 2,        /* and two between them, at which the fit is looked at */
    PIECE = 4 + 3 * NODES,       /* numbers of a piece: base quaternion, then c_0 ... c_9 */
};

/* Fit pieces to orientations at the Lobatto nodes -cos(pi i / 9) of each.
 *
 * The first and the last node are the ends of a piece, so pieces that share one agree there.  Two
 * orientations more, at -cos(pi (i + 1/2) / 9) for i = 1 and 6, tell how good the fit is.
 *
 * orientations: quaternions of either sign in the order of their instants, shape (n, 12, 4).
 * pieces: receives the table, shape (n, PIECE); each piece has the sign of its first orientation.
 * quality: receives the largest |r| at the nodes of each piece, and the largest error at the two
 *     instants between them, both in rad, shape (n, 2). */
void fit_trajectory(tensor_t orientations, matrix_t pieces, matrix_t quality);

/* Write orientation, angular velocity, acceleration and jerk at instants in any order.
 *
 * times: instants, s, shape (n,).
 * breaks: ends of the pieces, shape (m + 1,).
 * pieces: shape (m, PIECE).
 * slack: how far outside the domain an instant may be, s; such an instant is moved to the end.
 * out: receives quaternions, then velocities, accelerations and jerks as far as there are rows for
 *     them, shape (4, 10 or 13, n).
 *
 * Return the place of the first instant that is outside the domain, or -1 if none is. */
index_t sample_trajectory(row_t times, row_t breaks, matrix_t pieces, double slack, matrix_t out);

/* Write the coefficients c_0 ... c_9 of a rotation vector by its values at the nodes.
 *
 * negligible: rad, up to which Chebyshev coefficients at the end are left out as rounding. */
void put_polynomial(const vec_t *r, double negligible, double *c);

/* The rotation vector from one orientation to another, whose sign does not matter. */
INLINE vec_t rotation_vector(quat_t base, quat_t q) {
    quat_t turn = relative(base, q);
    turn = turn.w < 0.0 ? opposite(turn) : turn;
    double length = sqrt(turn.w * turn.w + turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
    return times(2.0, lane_logarithm(turn, length));
}

/* Return a rotation vector at u by its coefficients. */
INLINE vec_t polynomial_at(const double *c, double u) {
    vec_t sum = vec_at(c + 3 * DEGREE);
    for (int j = DEGREE - 1; j >= 0; j--)
        sum = scaled_plus(u, sum, vec_at(c + 3 * j));
    return sum;
}

/* retime.c */

/* Write the first two derivatives of a rotation vector from angular velocity and acceleration in the
 * body.
 *
 * half: s, in which the parameter changes by 1. */
void put_rates(vec_t r, vec_t omega, vec_t alpha, double half, vec_t *rate, vec_t *change);

/* Write the trajectory of a product of exponentials; see sampling.h.
 *
 * given: body angular velocity and acceleration at its beginning, then at its end, shape (4, 3); not
 *     numbers where they are the product's.
 * cuts: into how many equal pieces to cut each span at first.
 * ends, pieces: receive the table, shapes (m + 1,) and (m, PIECE).
 *
 * Return the number of pieces, or 0 if there is no room for them. */
index_t product_trajectory(const product_t *product, const double *given, index_t cuts,
                           row_t ends, matrix_t pieces);

/* Write a trajectory run through as a clock says, whose parameter is the time since the beginning of
 * the trajectory.
 *
 * breaks, pieces: the trajectory.
 * ends, out: receive the table, shapes (m + 1,) and (m, PIECE).
 *
 * Return the number of pieces, or 0 if there is no room for them. */
index_t retime_trajectory(row_t breaks, matrix_t pieces, const clocked_t *clock, row_t ends,
                          matrix_t out);

#endif
