/* A serial chain of turning axes that carries a tool: its motion within the limits of axes and tool.
 *
 * A chain is a row of numbers: the tool's pose with all angles at zero (orientation w, x, y, z,
 * position in m), then for each axis its unit direction and a point on it, both at angles of zero.
 * The pose is the product of the turns about those axes from the base on (Brockett 1984).
 *
 * The servo has joints and their backward differences as rows: angles, rates, changes of the rates.
 * It has the tool's differences as its guard computes them: angular velocity and acceleration in
 * the tool's frame, and the velocity. */
#ifndef ORIENTD_CHAIN_H
#define ORIENTD_CHAIN_H

#include "law.h"

enum {
    CHAIN_POSE = 7, CHAIN_AXIS = 6,
    /* Of an axis: range, velocity, acceleration, jerk. */
    AXIS_LOW = 0, AXIS_HIGH, AXIS_RATES, AXIS_LIMITS = AXIS_RATES + RATES,
    /* Of the tool: three norms, linear velocity and acceleration, a brake rate that plays no part,
     * three components each of the first three. */
    TOOL_LINEAR = RATES, TOOL_COMPONENTS = TOOL_LINEAR + 3,
    TOOL_LIMITS = TOOL_COMPONENTS + 3 * RATES,
    /* Of the joints. */
    JOINTS_AT = 0, JOINT_RATES, JOINT_CHANGES, JOINT_ROWS,
    /* Of the tool: angular velocity, angular acceleration, velocity. */
    TOOL_DIFFERENCES = 9,
    /* Of the reference, in time: now, one and two cycles before, a cycle later.  Only the first if
     * it is at rest. */
    NOW = 0, BEFORE, EARLIER, LATER, REFERENCE_ROWS,
    /* Of a cone: axis in the tool's frame, direction in the world, least angle between them. */
    CONE = 7,
    /* How to follow: share of the tool's limits, then manner_t. */
    FOLLOWING = 1 + sizeof(manner_t) / sizeof(double),
    /* Shares of the limits that the reference takes. */
    TAKEN = RATES,
    /* Why a stop is refused: kind, axis or cone, value, limit. */
    STRAIN = 4,
};

/* Kinds of limits that a stop would exceed. */
enum { RANGE = 1, AXIS_RATE, TOOL_RATE = AXIS_RATE + RATES, LINEAR_RATE = TOOL_RATE + RATES,
       IN_CONE = LINEAR_RATE + 2, TOO_LONG };

/* A chain in its limits: numbers as above, and the cycle period in s. */
typedef struct { row_t chain; matrix_t axes; row_t tool; double period; } limited_chain_t;

/* Write the accelerations of the joints for the next step towards a reference.
 *
 * A goal outside of a range is moved to its end.  An axis beyond its range at present may stay there.
 *
 * reference: its joints; with is_way a single row, the way to go.
 * taken: receives the shares of the limits that the reference itself takes.
 * goal: receives the joints that it goes to. */
void pursue_joints(const limited_chain_t *arm, matrix_t joints, matrix_t reference, bool is_way,
                   row_t following, row_t taken, row_t goal, row_t accelerations);

/* Roll a step out, and the stop after it, cycle by cycle with the differences of a guard.
 *
 * share: of the tool's limits that the stop aims at; the check is against all of them.
 * drift: angular velocity with which cones may turn, rad/s.
 * accelerations: of the joints in the step; without numbers the stop begins at once.
 * stop: receives the joints from the next setpoint on, and in the end those of rest.
 * strain: receives what exceeds a limit.
 *
 * Returns the number of setpoints, or 0 if a limit would be exceeded. */
index_t roll_stop(const limited_chain_t *arm, matrix_t joints, row_t differences, matrix_t cones,
                  double share, double drift, row_t accelerations, matrix_t stop, row_t strain);

/* Whether axes that brake each by itself keep the tool outside of cones, to the end.
 *
 * joints: angles at the last setpoint and rates of the step to the next, shape (2, n). */
bool brakes_outside(row_t chain, matrix_t axes, matrix_t joints, double period, matrix_t cones);

#endif
