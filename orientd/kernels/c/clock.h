/* The clock of a profile: where on a path a motion is at some time.
 *
 * On an element y = (dx/dt)^2 is quadratic, so x obeys a linear equation, x'' = a + c x, which
 * hyperbolic functions solve.  The path's own parameter s is a function of x that is fixed and
 * lets a device leave rest: where the angular velocity of the path falls to zero like s, but a
 * motion from rest turns by an angle like t^3, s must grow like x^(3/2).  Over a length L at such
 * an end
 *
 *     s = L (u^(3/2) - u^(5/2) / 5),   u = x / L,
 *
 * goes over into a slope of 1 without any curvature; elsewhere s and x differ by a constant.  Where
 * the path moves at its end and a motion along it is to rest there, s = L (u^3 - u^4 / 2) does the
 * same; such a length is given as -L.
 */
#ifndef ORIENTD_CLOCK_H
#define ORIENTD_CLOCK_H

#include "arrays.h"

/* Write when the nodes are passed.
 *
 * places: of the nodes, increasing from 0, shape (n + 1,).
 * values, slopes: of y there.
 * times: receives the times, from 0 on. */
void put_node_times(row_t places, row_t values, row_t slopes, row_t times);

/* Write the path's parameter and its first two derivatives by x.
 *
 * places: values of x, shape (m,).
 * leaves: lengths L or -L at the start and at the end, 0 where s and x differ by a constant.
 * total: the largest x.
 * out: receives s, from 0 on, and the derivatives, shape (3, m). */
void leave_rest(row_t places, row_t leaves, double total, matrix_t out);

/* Return by how much x is longer than s where it leaves rest over a length. */
double leaving_gap(double length);

/* Return x where the path's parameter, from 0 on, has a value. */
double coordinate_of(double parameter, const double leaves[2], double total);

/* A clock: its nodes, and the lengths over which it leaves rest. */
typedef struct { row_t times, places, values, slopes, leaves; } clocked_t;

/* Write the path's parameter and its first two derivatives by time.
 *
 * instants: in any order, held to where the clock runs, shape (m,).
 * out: receives them, shape (3, m). */
void sample_clock(const clocked_t *clock, row_t instants, matrix_t out);

/* A parameter and its first two derivatives by time. */
typedef struct { double s, rate, change; } pace_t;

/* Write the parameter at points of a part of an element, less what it is half way.
 *
 * begin, end: of the part.
 * points: from -1 at the beginning to 1 at the end, shape (count,).
 * paces: receives them.
 *
 * Return the parameter half way. */
double put_paces(const clocked_t *clock, index_t element, double begin, double end,
                 const double *points, int count, pace_t *paces);

/* Return when the parameter has some value. */
double time_of(const clocked_t *clock, double value);

#endif
