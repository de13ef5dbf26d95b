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

/* Rad, the longest turn of a piece, and of a step of the orientation. */
#define LONGEST_BENT 0.5

/* A limited rate: control points from the first on, with their shares, over a power of the
 * duration.
 *
 * by_duration: what the given control points add with the duration. */
typedef struct { int first, count, order; double share[3], by_duration[3]; } rate_t;

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

/* How a spline was shortened: not to one within the limits; until a single limit held it up, or the
 * steps ran out; or as far as the limits together allow. */
typedef enum { LOST, STUCK, CONVERGED } outcome_t;

/* Shorten a spline, to a whole number of periods. */
outcome_t shorten(spline_t *spline, double period);

/* shorten.c */

/* Replace the way by rest with a shorter connector, if one is found; false without memory.
 *
 * limits: of velocity, acceleration and jerk with their reserve, norm and components, shape (3, 4).
 * period: it takes a whole number of periods, s.
 * least: it takes at least this long, s.
 * most_turn: the integral of its angular velocity, body components, is no longer, rad, unless that of
 *     the way by rest is; negative for no shorter connector.
 * more: multiple of acceleration and jerk for another try where the first one gets stuck. */
bool shorten_connector(phases_t *rests, matrix_t limits, double period, double least,
                       double most_turn, double more);

/* connect.c */

/* Write the trajectory of the shortest way found from one state to another, and return how many
 * pieces it has; 0 if it takes too long.
 *
 * start, end: states, shape (10,).
 * own: limits of a stop from the start.
 * least, longest: that it may take, s.
 * The others are those of shorten_connector. */
index_t connect_states(row_t start, row_t end, matrix_t limits, matrix_t own, double period,
                       double least, double longest, double most_turn, double more,
                       row_t breaks, matrix_t pieces);

#endif
