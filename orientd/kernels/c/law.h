/* One step a cycle of several coordinates towards a moving reference, inside convex limits.
 *
 * The state is a chain of backward differences, as a guard computes them: the acceleration a
 * changes once a cycle, then v += h a, x += h v.  A limit is a gauge: a convex, symmetric and
 * homogeneous size of which no more than 1 is allowed.  Here it is the largest share of any
 * coordinate's own limit, of the limits of the tool's turn (norm and components), and of the norm of
 * the tool's velocity; the last two are linear in the coordinates.
 *
 * Why a stop always exists: from an allowed (v, a) let a fall along its own line to zero as fast as
 * the jerk allows.  The velocity moves on a chord meanwhile, whose end must be allowed too, so by
 * convexity all of it is.  From a = 0 the velocity falls along its own line, where all gauges are
 * multiples of each other. */
#ifndef ORIENTD_LAW_H
#define ORIENTD_LAW_H

#include "rotation.h"

enum { MOST_COORDINATES = 8 };
enum { VELOCITY, ACCELERATION, JERK, RATES };

/* Limits as reciprocals: 0 is without limit.
 *
 * n: number of coordinates.
 * period: of a cycle, s.
 * own: of each coordinate.
 * turn, move: what the tool turns in its own frame, and moves, per unit of each coordinate.
 * turning, components, moving: of the turn's norm, its three components, and the motion's norm. */
typedef struct {
    index_t n;
    double period, own[RATES][MOST_COORDINATES];
    vec_t turn[MOST_COORDINATES], move[MOST_COORDINATES];
    double turning[RATES], components[RATES][3], moving[RATES];
} gauges_t;

/* How hard to follow.
 *
 * approach: closing speed per remaining way, 1/s.
 * settle: acceleration per error of the velocity, 1/s.
 * share: part of the wanted change of acceleration that is made in a cycle.
 * spare: shares of the limits that the reference leaves free. */
typedef struct { double approach, settle, share, spare[RATES]; } manner_t;

/* Corrections near a reference that jumps about, for a follower that was close.
 *
 * near: way up to which they are linear.
 * margin: acceleration that they may take; infinity for no bound.
 * most: acceleration that they may take together with the reference's own. */
typedef struct { double near, margin, most; } calm_t;

/* The share of a limit that a velocity, an acceleration or a jerk takes. */
double gauge(const gauges_t *g, int rate, const double *u);

/* The gauge of velocity that a state can still keep: 1, or more if it is beyond. */
double loosened(const gauges_t *g, const double *v, const double *a);

/* Write the allowed acceleration nearest to a wanted one; top is the allowed gauge of velocity. */
void advance(const gauges_t *g, const double *v, const double *a, const double *wanted, double top,
             double *found);

/* Write the acceleration of one more cycle towards rest.
 *
 * aside: is added to the acceleration to aim at; may be NULL. */
void halt(const gauges_t *g, const double *v, const double *a, const double *aside, double *found);

/* Write the acceleration to aim at, to meet a reference soonest and stay with it.
 *
 * It closes in as fast as a stop relative to the reference permits, with the part of the limits that
 * the reference leaves free.  Near by, no limit is active, and the law is linear.
 *
 * e: way to the reference.
 * vr, ar: its velocity of the last step and acceleration.
 *
 * Returns whether the linear law gave it. */
bool pursue(const gauges_t *g, const manner_t *manner, const calm_t *calm, const double *e,
            const double *v, const double *a, const double *vr, const double *ar, double *wanted);

/* Turn a wanted acceleration towards braking if a stop after it would end far beyond the reference.
 *
 * That is beyond the end of the reference's own stop along the motion.  So it is true whatever the
 * reference does next within the limits.
 *
 * slack: way by which it may end beyond. */
void keep_distance(const gauges_t *g, double slack, const double *e, const double *v,
                   const double *a, const double *vr, const double *ar, double *wanted);

#endif
