/* Sine and cosine without a branch or a call, for loops that go to the vector units. */
#ifndef ORIENTD_LANES_H
#define ORIENTD_LANES_H

#include <math.h>

#include "arrays.h"
#include "fused.h"

/* Both of an angle, to the last digit or two: reduced by whole half turns, pi being taken in two
 * parts, the first so short that its multiples are exact; then Chebyshev interpolants in
 * z = x^2 on [0, (pi/2)^2], of cos x to 6e-17 and of sin(x)/x to 2e-17. */
INLINE void cosine_and_sine(double x, double *cosine, double *sine) {
    double turns = floor(fused(x, 0.3183098861837907, 0.5));
    double r = fused(-turns, 3.178650954705639e-08, fused(-turns, 3.1415926218032837, x));
    double half = 0.5 * turns;
    double sign = fused(-4.0, half - floor(half), 1.0);
    double z = r * r;
    double c = fused(z, 4.608977003001797e-14, -1.1462901901757276e-11);
    double s = fused(z, 2.7215749422983443e-15, -7.643026557971632e-13);
    c = fused(z, c, 2.0876561839933163e-09), s = fused(z, s, 1.605894087848656e-10);
    c = fused(z, c, -2.755731639102575e-07), s = fused(z, s, -2.505210689056952e-08);
    c = fused(z, c, 2.4801587277414926e-05), s = fused(z, s, 2.7557319211229606e-06);
    c = fused(z, c, -0.001388888888877299), s = fused(z, s, -0.00019841269841208676);
    c = fused(z, c, 0.04166666666666388), s = fused(z, s, 0.008333333333333186);
    c = fused(z, c, -0.4999999999999997), s = fused(z, s, -0.16666666666666666);
    c = fused(z, c, 1.0), s = fused(r * z, s, r);
    *cosine = sign * c;
    *sine = sign * s;
}

#endif
