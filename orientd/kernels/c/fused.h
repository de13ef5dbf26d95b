/* Multiply and add in one step, with one rounding where the processor can.
 *
 * Sampling writes it out, and adds no product in any other way: what a compiler fuses by itself
 * differs from loop to loop, and a sample would depend on which of them it went through.
 */
#ifndef ORIENTD_FUSED_H
#define ORIENTD_FUSED_H

#include "arrays.h"

/* a b + c */
INLINE double fused(double a, double b, double c) {
#if defined(__FMA__) || defined(__aarch64__)
    return __builtin_fma(a, b, c);
#else
    return a * b + c;
#endif
}

#endif
