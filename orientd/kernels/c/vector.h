/* The law of law.h for a vector: the turn of a tool in its own frame, or a position.
 *
 * Limits are a row: the norms of velocity, acceleration and jerk, then three components of each.
 * A state is a row of three vectors: the way to a reference, velocity, acceleration. */
#ifndef ORIENTD_VECTOR_H
#define ORIENTD_VECTOR_H

#include "law.h"

enum {
    VECTOR_LIMITS = 4 * RATES, VECTOR_STATE = 9, WAY = 0, SPEED = 3, CHANGE = 6,
    /* How to follow: manner_t, calm_t, how far beyond a stop may end. */
    VECTOR_FOLLOWING = (sizeof(manner_t) + sizeof(calm_t)) / sizeof(double) + 1,
};

/* Write the acceleration of the next step towards a reference.
 *
 * reference: its velocity of the last step, its acceleration, that with the next step.
 * taken: the shares of the limits that the reference takes.
 *
 * Returns whether the linear law gave it. */
bool pursue_vector(row_t limits, double period, row_t state, row_t reference, row_t following,
                   row_t taken, row_t acceleration);

/* Write the acceleration of the next step towards rest; aside is added to the one to aim at. */
void halt_vector(row_t limits, double period, row_t state, row_t aside, row_t acceleration);

/* The least angle between cones and the edge of a tool's way while it stops, rad.
 *
 * Inside of a cone it is the turn outwards of each step, which must not be negative.
 *
 * state: velocity and acceleration of the step that the stop begins with.
 * cones: axis and direction, both in the tool's frame before that step, and least angle. */
double stop_clearance(row_t limits, double period, row_t state, matrix_t cones);

#endif
