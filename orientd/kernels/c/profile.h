/* The quickest way along a path: its speed, a barrier method that finds it, and its clock.
 *
 * A path has a parameter x, and y = (dx/dt)^2 is sought as a function of it.  What is limited is
 * then a vector of the form (Bobrow, Dubowsky and Gibson 1985)
 *
 *     p' sqrt(y),   p'' y + p' y' / 2,   sqrt(y) (p''' y + 3/2 p'' y' + p' y'' / 2),
 *
 * and the duration is the integral of 1 / sqrt(y).  Without the jerk this is a convex problem in y
 * (Verscheure et al. 2009, IEEE TAC 54); a limit of the jerk, |p''' y + ...| <= J / sqrt(y), is
 * convex on the left and convex on the right, and the tangent of the right side is an inner
 * approximation (Debrouwere et al. 2013, IEEE TRO 29).
 *
 * y is a quadratic spline with a knot at every node, so that its second derivative is one number
 * on every element between two nodes, as the jerk is that of the quickest motions.
 */
#ifndef ORIENTD_PROFILE_H
#define ORIENTD_PROFILE_H

#include "arrays.h"

enum { PROFILE_FOUND = 1, PROFILE_NOT_FOUND = 0 };

enum { MOST_AXES = 8 };  /* of a mechanism */

/* A path for which a profile is sought. */
typedef struct {
    row_t widths;                   /* of the elements, shape (n,) */
    matrix_t first, second;         /* derivatives of the orientation by the parameter, in body
                                       components, at nodes and middles, shape (2 n + 1, 3) */
    matrix_t move_first, move_second; /* those of the position, or shape (0, 3) */
    matrix_t limits;                /* of velocity, acceleration and jerk, norm and components */
    row_t move_limits;              /* of the position's velocity and acceleration */
    double *axis_first, *axis_second; /* those of the axes' angles, in groups of three axes, each of
                                         shape (2 n + 1, 3); the last is filled up with zeros */
    matrix_t axis_limits;           /* of the axes' velocity, acceleration and jerk, shape (3, axes);
                                       without the last row the jerk is free */
    matrix_t aims;                  /* what the limits of each element are divided by, (3, n) */
    bool has_start, has_end;        /* whether value and slope are given there */
} profile_path_t;

/* profile.c */

/* Improve a profile until the barrier costs a share of the duration.
 *
 * begin: share to begin with; less than 1 where the coefficients are good already.
 * gap: the share to end with.
 * coefficients: of the quadratic B-splines, shape (n + 2,), positive; the first two stay where the
 *     start is given, and so the last two.  Need not keep anything.
 * shares: receives the largest share of velocity, acceleration and jerk in each element, as seen at
 *     five places, shape (3, n).
 *
 * Return PROFILE_FOUND, PROFILE_NOT_FOUND where the limits leave no way, or OUT_OF_MEMORY. */
int find_profile(const profile_path_t *path, double begin, double gap, row_t coefficients,
                 matrix_t shares);

/* profile_shares.c */

/* A limited rate along the path: derivatives of its quantity, its limit, and the axis of a mechanism
 * that it belongs to, or -1. */
typedef struct {
    const double *first, *second;
    index_t axis;
    double limit;
    int order;
    index_t at;
} rate_t;
enum { ALL_AXES = -1, MOST_RATES = 14 + 3 * MOST_AXES };

/* Write the rates that are limited, of orders 1 to 3, and return how many there are. */
int put_limited(const profile_path_t *path, rate_t rates[MOST_RATES]);

/* Write the largest shares of an order that a profile has, element by element.
 *
 * values, slopes: of y at the nodes, shape (n + 1,).  */
void put_shares(const profile_path_t *path, const double *values, const double *slopes,
                matrix_t shares);

/* Take away limits of axes of which a profile has less than a share; return whether none is left. */
bool free_axes(const profile_path_t *path, const double *values, const double *slopes,
               double share);

#endif
