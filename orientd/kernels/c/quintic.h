/* Polynomials of degree five: by values and two derivatives at both ends, and what they are in between.
 *
 * Of several numbers side by side, those of one are a stride apart.
 */
#ifndef ORIENTD_QUINTIC_H
#define ORIENTD_QUINTIC_H

#include "arrays.h"

enum { QUINTIC = 6 };  /* coefficients */

/* Write the coefficients of the powers of the time since the beginning.
 *
 * h: duration.
 * first, last: value and its first two derivatives at both ends. */
INLINE void put_quintic(double h, const double first[3], const double last[3], double *c,
                        index_t stride) {
    double way = last[0] - first[0] - h * (first[1] + 0.5 * h * first[2]);
    double speed = h * (last[1] - first[1] - h * first[2]), push = h * h * (last[2] - first[2]);
    double cube = h * h * h;
    c[0] = first[0], c[stride] = first[1], c[2 * stride] = 0.5 * first[2];
    c[3 * stride] = (10.0 * way - 4.0 * speed + 0.5 * push) / cube;
    c[4 * stride] = (-15.0 * way + 7.0 * speed - push) / (cube * h);
    c[5 * stride] = (6.0 * way - 3.0 * speed + 0.5 * push) / (cube * h * h);
}

/* Write the value and its first three derivatives at a time since the beginning. */
INLINE void quintic_at(const double *c, index_t stride, double u, double found[4]) {
    double p = 0.0, p1 = 0.0, p2 = 0.0, p3 = 0.0;
    for (int power = QUINTIC - 1; power >= 0; power--) {
        p3 = p3 * u + p2;
        p2 = p2 * u + p1;
        p1 = p1 * u + p;
        p = p * u + c[power * stride];
    }
    found[0] = p, found[1] = p1, found[2] = 2.0 * p2, found[3] = 6.0 * p3;
}

/* Where position, velocity and acceleration are written, three numbers each; NULL where not. */
typedef struct { double *position, *velocity, *acceleration; } move_t;

/* Write a position at an instant; before the first quintic and after the last one it stays.
 *
 * breaks: where the quintics begin and end, shape (m + 1,), m > 0.
 * moves: three components of each of six coefficients, shape (m, 18). */
static inline void put_move(row_t breaks, matrix_t moves, double t, move_t to) {
    index_t last = breaks.n - 1;
    bool is_still = !(t >= breaks.v[0] && t < breaks.v[last]);
    double held = t < breaks.v[0] ? breaks.v[0] : t < breaks.v[last] ? t : breaks.v[last];
    index_t piece = piece_of(held, breaks);
    const double *c = row_of(moves, piece);
    double u = held - breaks.v[piece], moving = is_still ? 0.0 : 1.0;
    for (int k = 0; k < 3; k++) {
        double at[4];
        quintic_at(c + k, 3, u, at);
        if (to.position != NULL)
            to.position[k] = at[0];
        if (to.velocity != NULL)
            to.velocity[k] = moving * at[1];
        if (to.acceleration != NULL)
            to.acceleration[k] = moving * at[2];
    }
}

#endif
