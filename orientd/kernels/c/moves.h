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
    index_t low = 0, high = breaks.n - 1;
    bool is_still = !(t >= breaks.v[0] && t < breaks.v[high]);
    double held = t < breaks.v[0] ? breaks.v[0] : t < breaks.v[high] ? t : breaks.v[high];
    while (high - low > 1) {
        index_t middle = (low + high) / 2;
        if (breaks.v[middle] <= held)
            low = middle;
        else
            high = middle;
    }
    const double *c = row_of(moves, low);
    double u = held - breaks.v[low], moving = is_still ? 0.0 : 1.0;
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
