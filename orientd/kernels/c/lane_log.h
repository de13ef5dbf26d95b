/* The logarithm of a quaternion without a branch or a call, for loops that go to the vector units. */
#ifndef ORIENTD_LANE_LOG_H
#define ORIENTD_LANE_LOG_H

#include "rotation.h"

/* The half-angle vector of a quaternion with the sign it has, of a norm above zero that is given, as
 * logarithm of rotation.h.
 *
 * The angle x of the point (|w|, |v|) is folded at pi/4 and halved, tan(x/2) = sin x / (1 + cos x),
 * so that the arc tangent is wanted on [0, tan(pi/8)] only: a Chebyshev interpolant of
 * (atan(t)/t - 1)/t^2 in z = t^2, to 6e-18. */
INLINE vec_t lane_logarithm(quat_t q, double size) {
    double length = sqrt(q.x * q.x + q.y * q.y + q.z * q.z), w = fabs(q.w);
    double low = length < w ? length : w, high = length < w ? w : length;
    double t = low / (high + size), z = t * t;
    double p = -0.0909090457530649 + z * (0.07692183125376892 + z * (-0.06664510525508936
             + z * (0.05858140904866328 + z * (-0.050854078345894844 + z * (0.03923044778479309
             + z * -0.019175404711104935)))));
    p = -0.3333333333333333 + z * (0.19999999999995516 + z * (-0.14285714284665682
      + z * (0.11111111015187018 + z * p)));
    double angle = 2.0 * (t + t * z * p);
    /* The rounding errors of pi and pi/2 matter when the angle is subtracted from them. */
    angle = length > w ? 1.5707963267948966 - (angle - 6.123233995736766e-17) : angle;
    angle = q.w < 0.0 ? 3.141592653589793 - (angle - 1.2246467991473532e-16) : angle;
    double over = length > 0.0 ? angle : q.w > 0.0 ? 1.0 : 0.0;
    double factor = over / (length > 0.0 ? length : q.w > 0.0 ? q.w : 1.0);
    double whole = length > 0.0 || !(q.w < 0.0) ? 0.0 : 3.141592653589793;
    return vec(factor * q.x + whole, factor * q.y, factor * q.z);
}

#endif
