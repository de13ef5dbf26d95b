/* Kinematics of arms with six joints built like those of Universal Robots: shoulder, elbow and first
 * wrist axis are parallel, and each following axis is at a right angle to the one before it.
 *
 * The geometric solution goes joint by joint:
 *
 * - The fifth frame lies d6 behind the flange, and off the plane of shoulder and elbow by d4, which
 *   gives the base angle.
 * - The tool's axis relative to that plane gives the second wrist angle.  The plane seen from the
 *   tool gives the third.
 * - The rest is a triangle of upper arm and forearm in the plane.
 *
 * Two choices each at shoulder, wrist and elbow make eight solutions.  At a straight second wrist
 * the first and third turn about the same axis; there the third keeps its angle.
 *
 * An arm's own calibration differs from the published table by some tenths of a millimetre, and its
 * axes are not quite parallel.  Its joints come from an iteration: solve the published arm for a
 * pose shifted by the present error.  Each round is a thousand times closer.
 *
 * An arm is a row of numbers: the published lengths d1, upper arm, forearm, d4, d5, d6; then the
 * published table and, if the arm is calibrated, its own.  A table has five numbers for each joint:
 * theta, a and d of Denavit and Hartenberg, and cosine and sine of alpha. */
#ifndef ORIENTD_ARMS_H
#define ORIENTD_ARMS_H

#include "arrays.h"

enum {
    ARM_JOINTS = 6,
    ARM_BRANCHES = 8,
    ARM_POSE = 7,      /* orientation (w, x, y, z), position in m */
    ARM_RESERVES = 3,  /* wrist, elbow, shoulder */
    DH_COLUMNS = 5,
    PUBLISHED_ARM = ARM_JOINTS + ARM_JOINTS * DH_COLUMNS,
    CALIBRATED_ARM = PUBLISHED_ARM + ARM_JOINTS * DH_COLUMNS,
};

/* Write the pose of each joint's frame in the base; the last is that of the flange.
 *
 * joints: rad.
 * is_own: by the arm's own table, or by the published one.
 * poses: receives them, shape (6, 7). */
void place_arm(row_t arm, bool is_own, row_t joints, matrix_t poses);

/* Write the joints of every branch for the tool at a pose, and return how many there are.
 *
 * tool: pose of the tool in the flange.
 * joints: receives them, rad, without whole turns, shape (8, 6). */
index_t solve_arm(row_t arm, row_t tool, row_t pose, matrix_t joints);

/* Write the joints for poses of the tool one after the other, each nearest to the one before it.
 *
 * This is the solution on the branch of the joints before if it is close, otherwise the nearest of
 * all.  Angles go beyond the joints' range if only a jump would lead back into it.
 *
 * tool: pose of the tool in the flange.
 * near: joints near the first pose, rad.
 * joints: receives them, rad, shape (n, 6).
 *
 * Returns how many poses the arm reaches before the first that it does not. */
index_t follow_arm(row_t arm, row_t tool, matrix_t poses, row_t near, matrix_t joints);

/* Write how far joints are from each kind of singularity; 0 is singular.
 *
 * reserves: receives the sines of the bends of the second wrist and the elbow, and the distance of
 *     the fifth frame from the cylinder about the base axis that it cannot enter, m; shape (n, 3). */
void reserve_arm(row_t arm, matrix_t joints, matrix_t reserves);

#endif
