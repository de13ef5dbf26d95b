/* Positions that go along with an orientation: quintics by the time since each begins. */
#ifndef ORIENTD_MOVES_H
#define ORIENTD_MOVES_H

#include <string.h>

#include "arrays.h"

/* Where position, velocity and acceleration are written, three numbers each; NULL where not. */
typedef struct { double *position, *velocity, *acceleration; } move_t;

/* Write a position at an instant, of the quintic that begins there; before the first and after the
 * last one it stays.
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
        double p = 0.0, p1 = 0.0, p2 = 0.0;
        for (int power = 5; power >= 0; power--) {
            p2 = p2 * u + p1;
            p1 = p1 * u + p;
            p = p * u + c[3 * power + k];
        }
        if (to.position != NULL)
            to.position[k] = p;
        if (to.velocity != NULL)
            to.velocity[k] = moving * p1;
        if (to.acceleration != NULL)
            to.acceleration[k] = moving * 2.0 * p2;
    }
}

#endif
