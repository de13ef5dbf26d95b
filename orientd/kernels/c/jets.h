/* Differentiate quaternion constructions: what takes and returns jets, see orientd.curves. */
#ifndef ORIENTD_JETS_H
#define ORIENTD_JETS_H

#include "arrays.h"

/* A quantity with its first and second derivatives with respect to time: three arrays of one
 * shape, (n,) of scalars, (n, 3) of half-angle vectors, (n, 4) of unit quaternions. */
typedef struct { double *value, *first, *second; } jets_t;

/* Write the exponentials of n half-angle vectors. */
void exponentials(index_t n, jets_t vectors, jets_t out);

/* Write the logarithms of n quaternions, each with the sign it has. */
void logarithms(index_t n, jets_t quaternions, jets_t out);

/* Write p exp(u log(p* q)), everything moving: not a number where the two are opposite. */
void slerps(index_t n, jets_t p, jets_t q, jets_t u, jets_t out);

/* Write p exp(u w) of quaternions and half-angle vectors that do not move. */
void geodesics(index_t n, const double *p, const double *w, jets_t u, jets_t out);

#endif
