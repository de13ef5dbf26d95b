/* The shortest connector: an interior-point method over splines of the angular velocity.
 *
 * In body components the acceleration is the derivative of the velocity, and the jerk that of the
 * acceleration.  So every limit is convex in a velocity given by control points.  Only the final
 * orientation is not convex, but it is nearly linear in the control points.  The velocity is a
 * quadratic spline with a knot at each end of its elements.  So its jerk is constant in an element,
 * as in the quickest motions.  Elements are narrow near the ends, because a delay there of part of an
 * element cannot be made up later.
 *
 * The unknowns are the control points c and the duration.  A primal-dual interior-point method finds
 * them from an infeasible start (Nocedal and Wright 2006, sec. 19.3).  It keeps only the convex part
 * of the curvature.  The band of the matrix is that of a jerk, which takes three control points.  The
 * duration and the final orientation are its border.
 */
#ifndef ORIENTD_SHORTEN_H
#define ORIENTD_SHORTEN_H

#include "connectors.h"

enum {
    INNER = 16,                        /* elements of one width, at most */
    HALVINGS = 8,                      /* of that width towards either end, at most */
    ELEMENTS = INNER + 2 * (HALVINGS + 1),
    POINTS = ELEMENTS + 2,             /* control points; the first two and the last two are given */
    FREE = 3 * (POINTS - 4),           /* components of the others */
    BAND = 9,                          /* of a row, from the diagonal on */
    PARTS = 4,                         /* of an element, whose velocities are limited each */
    RATES = (PARTS + 2) * ELEMENTS,    /* velocities, accelerations and jerks that are limited */
    BORDER = 5,                        /* right sides: step, duration, orientation */
};

/* A limited rate: control points from the first on, with their shares, over a power of the
 * duration.
 *
 * by_duration: what the given control points add with the duration.
 * ease: factor of its limits. */
typedef struct { int first, count, order; double share[3], by_duration[3], ease; } rate_t;

/* A connector as a spline of its velocity. */
typedef struct {
    int elements;
    double width[ELEMENTS];            /* shares of the duration */
    double sum[ELEMENTS + 1];          /* of the widths at both sides of a node */
    motion_t begin, end;               /* the sign of the end is the way round */
    bounds_t bounds;
    double least, most;                /* durations, s */
    vec_t point[POINTS];
    double duration;
    quat_t node[ELEMENTS + 1];         /* orientations at the nodes */
    int rates;
    rate_t rate[RATES];
} spline_t;

/* Put the given control points in place for the duration. */
void put_given(spline_t *spline);
/* Velocity at a node. */
vec_t velocity_at(const spline_t *spline, int node);
/* Acceleration at a node. */
vec_t acceleration_at(const spline_t *spline, int node);

/* shorten_steps.c */

/* Shorten a spline, to a whole number of periods; false where that has not converged. */
bool shorten(spline_t *spline, double period);

/* shorten.c */

/* Write the joins of a connector that is shorter than one already found, or than a guess.  Return the
 * number of joins, or 0 if there is no shorter connector.
 *
 * start, end, limits, period, least, most_turn: as of find_connector.
 * longest: it takes no longer than this, s.
 * ease: factor of the jerk's limits where an acceleration would else become too fast as it falls.
 * q, w, times: the connector to begin with, as find_connector writes it.
 * joins: receives orientations that they begin at, signs continuous, shape (ELEMENTS, 4).
 * increments: receives their increments, shape (ELEMENTS, 5, 3).
 * breaks: receives when they begin, and when the last one ends, s, shape (ELEMENTS + 1,). */
index_t shorten_connector(row_t start, row_t end, matrix_t limits, double period, double least,
                          double most_turn, double longest, double ease, matrix_t q, tensor_t w, row_t times,
                          matrix_t joins, tensor_t increments, row_t breaks);

/* connect.c */

enum { MOST_JOINS = ELEMENTS + 2 };  /* of a connector, and of two ramps before it */

/* Write the joins of the shortest way found from one state to another, and return how many there
 * are; 0 if there is none.
 *
 * start, end: states, shape (10,).
 * limits: of velocity, acceleration and jerk with their reserve, norm and components, shape (3, 4).
 * own: the same without a reserve, which the velocity keeps while the acceleration falls.
 * period: it takes a whole number of periods, s.
 * least, longest: that it may take, s.
 * most_turn: as of find_connector.
 * ease: as of shorten_connector.
 * as_found: whether to leave it as find_connector finds it.
 * falls_first: whether the acceleration falls first in any case, rather than where it has to.
 * q: receives the orientations that they begin at, signs continuous, shape (MOST_JOINS, 4).
 * w: receives their increments, shape (MOST_JOINS, 5, 3).
 * breaks: receives when they begin, and when the last one ends, s, shape (MOST_JOINS + 1,). */
index_t connect_states(row_t start, row_t end, matrix_t limits, matrix_t own, double period,
                       double least, double longest, double most_turn, double ease, bool as_found,
                       bool falls_first, matrix_t q, tensor_t w, row_t breaks);

#endif
