/* Vectors and unit quaternions (w, x, y, z) as values, and their motions.
 *
 * Half-angle vectors are what exponential takes and logarithm returns; angular velocities are
 * physical and seen in the body.  The formulas are those of orientd.rotation.
 */
#ifndef ORIENTD_ROTATION_H
#define ORIENTD_ROTATION_H

#include <math.h>

#include "arrays.h"
#include "fused.h"

#ifndef M_PI
#define M_PI 3.14159265358979323846
#endif

/* Rad, below which a series replaces the quotient that cancels. */
#define SEAM 0.25

typedef struct { double x, y, z; } vec_t;
typedef struct { double w, x, y, z; } quat_t;
typedef struct { quat_t q; vec_t omega, alpha; } motion_t;

INLINE vec_t vec(double x, double y, double z) { return (vec_t){x, y, z}; }
INLINE quat_t quat(double w, double x, double y, double z) { return (quat_t){w, x, y, z}; }
INLINE vec_t vec_at(const double *v) { return (vec_t){v[0], v[1], v[2]}; }
INLINE quat_t quat_at(const double *v) { return (quat_t){v[0], v[1], v[2], v[3]}; }
INLINE void put_vec(double *v, vec_t a) { v[0] = a.x, v[1] = a.y, v[2] = a.z; }
INLINE void put_quat(double *v, quat_t q) { v[0] = q.w, v[1] = q.x, v[2] = q.y, v[3] = q.z; }

INLINE vec_t plus(vec_t a, vec_t b) { return vec(a.x + b.x, a.y + b.y, a.z + b.z); }
INLINE vec_t minus(vec_t a, vec_t b) { return vec(a.x - b.x, a.y - b.y, a.z - b.z); }
INLINE vec_t times(double s, vec_t a) { return vec(s * a.x, s * a.y, s * a.z); }
INLINE double dot(vec_t a, vec_t b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
INLINE double norm(vec_t a) { return sqrt(dot(a, a)); }
/* s a + b */
INLINE vec_t scaled_plus(double s, vec_t a, vec_t b) {
    return vec(fused(s, a.x, b.x), fused(s, a.y, b.y), fused(s, a.z, b.z));
}
INLINE vec_t cross(vec_t a, vec_t b) {
    return vec(fused(a.y, b.z, -(a.z * b.y)), fused(a.z, b.x, -(a.x * b.z)),
               fused(a.x, b.y, -(a.y * b.x)));
}
/* a x b + c */
INLINE vec_t cross_plus(vec_t a, vec_t b, vec_t c) {
    return vec(fused(a.y, b.z, fused(-a.z, b.y, c.x)), fused(a.z, b.x, fused(-a.x, b.z, c.y)),
               fused(a.x, b.y, fused(-a.y, b.x, c.z)));
}

INLINE quat_t conjugated(quat_t q) { return quat(q.w, -q.x, -q.y, -q.z); }
INLINE quat_t opposite(quat_t q) { return quat(-q.w, -q.x, -q.y, -q.z); }
INLINE quat_t multiplied(quat_t p, quat_t q) {
    return quat(fused(-p.z, q.z, fused(-p.y, q.y, fused(-p.x, q.x, p.w * q.w))),
                fused(-p.z, q.y, fused(p.y, q.z, fused(p.x, q.w, p.w * q.x))),
                fused(p.z, q.x, fused(p.y, q.w, fused(-p.x, q.z, p.w * q.y))),
                fused(p.z, q.w, fused(-p.y, q.x, fused(p.x, q.y, p.w * q.z))));
}

/* p* q, with all digits where the two are close, as orientd.rotation.between. */
INLINE quat_t relative(quat_t p, quat_t q) {
    double w = p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z;
    double sign = copysign(1.0, w);
    quat_t change = quat(q.w - sign * p.w, q.x - sign * p.x, q.y - sign * p.y, q.z - sign * p.z);
    quat_t turn = multiplied(conjugated(p), change);
    turn.w = w;
    return turn;
}

INLINE double square_apart(quat_t p, quat_t q, double sign) {
    double w = q.w - sign * p.w, x = q.x - sign * p.x, y = q.y - sign * p.y, z = q.z - sign * p.z;
    return w * w + x * x + y * y + z * z;
}

/* The quaternion of a half-angle vector. */
INLINE quat_t exponential(vec_t v) {
    double length = norm(v);
    double sinc = length > 0.0 ? sin(length) / length : 1.0;
    return quat(cos(length), sinc * v.x, sinc * v.y, sinc * v.z);
}

/* The half-angle vector of a quaternion with the sign it has. */
INLINE vec_t logarithm(quat_t q) {
    double length = sqrt(q.x * q.x + q.y * q.y + q.z * q.z), factor;
    if (length > 0.0)
        factor = atan2(length, q.w) / length;
    else if (q.w < 0.0)
        return vec(M_PI, 0.0, 0.0);
    else
        factor = q.w > 0.0 ? 1.0 / q.w : 0.0;
    return vec(factor * q.x, factor * q.y, factor * q.z);
}

/* Of the two quaternions of a turn the shorter one's; of a half turn as nearer_sign of
 * orientd.rotation, which explains the bounds. */
INLINE quat_t shorter(quat_t turn) {
    double part = fabs(turn.w) > 1e-7 ? turn.w : fabs(turn.z) > 1e-6 ? turn.z
                : fabs(turn.y) > 1e-6 ? turn.y : turn.x;
    return part < 0.0 ? opposite(turn) : turn;
}

/* A vector rotated by a unit quaternion. */
INLINE vec_t turned(quat_t q, vec_t v) {
    vec_t e = vec(q.x, q.y, q.z), t = times(2.0, cross(e, v));
    return plus(plus(v, times(q.w, t)), cross(e, t));
}

/* A vector seen after the turn (c, e): rotated by the conjugate of that quaternion. */
INLINE vec_t turned_back(double c, vec_t e, vec_t v) {
    vec_t t = times(2.0, cross(v, e));
    return cross_plus(t, e, scaled_plus(c, t, v));
}

/* An orientation followed by the turn (c, e). */
INLINE quat_t followed(quat_t q, double c, vec_t e) {
    return multiplied(q, quat(c, e.x, e.y, e.z));
}

/* Join angular velocity and acceleration, as seen after a factor, with those of the factor,
 * which turns about a fixed axis (Sommer et al., 2020, eq. 30 and 38). */
INLINE void join(vec_t *omega, vec_t *alpha, vec_t axis, double rate, double curvature) {
    vec_t own = times(rate, axis);
    *alpha = cross_plus(*omega, own, scaled_plus(curvature, axis, *alpha));
    *omega = scaled_plus(rate, axis, *omega);
}

/* a = (1 - cos t) / t^2 and b = (t - sin t) / t^3 of the right Jacobian, t^2 = square. */
INLINE void jacobian_factors(double square, double *a, double *b) {
    double theta = sqrt(square), half = 0.5 * theta;
    double sinc = half > 0.0 ? sin(half) / half : 1.0;
    *a = 0.5 * sinc * sinc;
    if (theta < SEAM)
        *b = 1.0 / 6 + square * (-1.0 / 120 + square * (1.0 / 5040
             + square * (-1.0 / 362880 + square / 39916800)));
    else
        *b = (theta - sin(theta)) / (theta * square);
}

#endif
