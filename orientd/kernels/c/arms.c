/* Kinematics of arms with six joints; see arms.h. */
#include "arms.h"

#include <string.h>

#include "rotation.h"

#define TURN (2.0 * M_PI)

/* Sine of the second wrist's bend below which the third keeps its angle. */
#define STRAIGHT 1e-7
/* Rad, within which a solution on the same branch is the nearest of all. */
#define SAME_BRANCH 0.1
/* A calibration of tenths of a millimetre needs three rounds, away from singularities.  After a last
 * change of this size the error is a thousand times smaller. */
enum { ROUNDS = 25 };
#define SETTLED 1e-10
/* Rad and m, within which the flange is at its pose. */
#define REACHED 1e-9

typedef struct { vec_t x, y, z; } frame_axes_t;
typedef struct { quat_t q; vec_t p; } place_t;
typedef struct { double shoulder, wrist, elbow; } branch_t;
typedef struct { double d1, upper_arm, forearm, d4, d5, d6; } links_t;

static links_t links_of(row_t arm) {
    const double *v = arm.v;
    return (links_t){v[0], v[1], v[2], v[3], v[4], v[5]};
}

static const double *published(row_t arm) { return arm.v + ARM_JOINTS; }
static bool is_calibrated(row_t arm) { return arm.n == CALIBRATED_ARM; }
static const double *own(row_t arm) {
    return arm.v + (is_calibrated(arm) ? PUBLISHED_ARM : ARM_JOINTS);
}

static place_t place_at(const double *v) { return (place_t){quat_at(v), vec_at(v + 4)}; }

/* The world axes rotated by a unit quaternion: the columns of its matrix. */
static frame_axes_t axes_of(quat_t q) {
    double w = q.w, x = q.x, y = q.y, z = q.z;
    return (frame_axes_t){
        {1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)},
        {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)},
        {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)},
    };
}

/* The unit quaternion that rotates the world axes to these, by its largest component. */
static quat_t quat_of(frame_axes_t f) {
    double w = 1 + f.x.x + f.y.y + f.z.z, x = 1 + f.x.x - f.y.y - f.z.z;
    double y = 1 - f.x.x + f.y.y - f.z.z, z = 1 - f.x.x - f.y.y + f.z.z;
    double wx = f.y.z - f.z.y, wy = f.z.x - f.x.z, wz = f.x.y - f.y.x;
    double xy = f.y.x + f.x.y, xz = f.z.x + f.x.z, yz = f.z.y + f.y.z;
    double largest = larger(larger(w, x), larger(y, z)), s = 0.5 / sqrt(largest);
    if (largest == w)
        return quat(s * w, s * wx, s * wy, s * wz);
    if (largest == x)
        return quat(s * wx, s * x, s * xy, s * xz);
    if (largest == y)
        return quat(s * wy, s * xy, s * y, s * yz);
    return quat(s * wz, s * xz, s * yz, s * z);
}

/* Advance from one joint's frame to the next by a row of a table. */
static void go_on(frame_axes_t *f, vec_t *p, const double row[DH_COLUMNS], double joint) {
    double c = cos(row[0] + joint), s = sin(row[0] + joint);
    vec_t across = minus(times(c, f->y), times(s, f->x)), along = f->z;
    f->x = plus(times(c, f->x), times(s, f->y));
    *p = plus(*p, plus(times(row[2], along), times(row[1], f->x)));
    f->y = plus(times(row[3], across), times(row[4], along));
    f->z = minus(times(row[3], along), times(row[4], across));
}

static place_t flange_at(const double *table, const double joints[ARM_JOINTS]) {
    frame_axes_t f = axes_of(quat(1.0, 0.0, 0.0, 0.0));
    vec_t p = vec(0.0, 0.0, 0.0);
    for (int k = 0; k < ARM_JOINTS; k++)
        go_on(&f, &p, table + DH_COLUMNS * k, joints[k]);
    return (place_t){quat_of(f), p};
}

void place_arm(row_t arm, bool is_own, row_t joints, matrix_t poses) {
    const double *table = is_own ? own(arm) : published(arm);
    frame_axes_t f = axes_of(quat(1.0, 0.0, 0.0, 0.0));
    vec_t p = vec(0.0, 0.0, 0.0);
    for (int k = 0; k < ARM_JOINTS; k++) {
        go_on(&f, &p, table + DH_COLUMNS * k, joints.v[k]);
        put_quat(row_of(poses, k), quat_of(f));
        put_vec(row_of(poses, k) + 4, p);
    }
}

/* The origin of the fifth frame. */
static vec_t wrist_of(const links_t *links, place_t pose) {
    return scaled_plus(-links->d6, axes_of(pose.q).z, pose.p);
}

/* The joints of the published arm on one branch; false if the pose is out of reach. */
static bool solve(const links_t *links, place_t pose, branch_t on, double last_q6, double *joints) {
    frame_axes_t r = axes_of(pose.q);
    vec_t wrist = wrist_of(links, pose);
    double reach = hypot(wrist.x, wrist.y), d4 = links->d4;
    if (reach < d4)
        return false;
    double q1 = atan2(wrist.y, wrist.x)
                + on.shoulder * atan2(sqrt((reach - d4) * (reach + d4)), d4) + 0.5 * M_PI;
    double c1 = cos(q1), s1 = sin(q1);
    /* The normal of the arm's plane, (s1, -c1, 0), in the flange's coordinates. */
    double nx = r.x.x * s1 - r.x.y * c1, ny = r.y.x * s1 - r.y.y * c1;
    double nz = r.z.x * s1 - r.z.y * c1;
    double sine5 = hypot(nx, ny), q5 = atan2(on.wrist * sine5, nz);
    double q6 = sine5 < STRAIGHT ? last_q6 : atan2(-on.wrist * ny, on.wrist * nx);
    double c6 = cos(q6), s6 = sin(q6);
    /* y of the fourth frame, negative, from the flange; the plane's angle from it. */
    double ax = r.x.x * s6 + r.y.x * c6, ay = r.x.y * s6 + r.y.y * c6;
    double az = r.x.z * s6 + r.y.z * c6, outward = ax * c1 + ay * s1;
    double bend = atan2(-outward, az);
    double px = wrist.x * c1 + wrist.y * s1 + links->d5 * outward;
    double pz = wrist.z - links->d1 + links->d5 * az;
    /* The third side of the triangle, compared with the two others extended and folded. */
    double side = hypot(px, pz), stretched = links->upper_arm + links->forearm;
    double folded = links->upper_arm - links->forearm;
    double above = (stretched - side) * (stretched + side);
    double below = (side - folded) * (side + folded);
    if (above < 0.0 || below < 0.0)
        return false;
    double q3 = on.elbow * 2.0 * atan2(sqrt(above), sqrt(below));
    double q2 = atan2(-pz, -px)
                - atan2(links->forearm * sin(q3), links->upper_arm + links->forearm * cos(q3));
    joints[0] = q1, joints[1] = q2, joints[2] = q3;
    joints[3] = bend - q2 - q3, joints[4] = q5, joints[5] = q6;
    return true;
}

static double sign_of(double x) { return x >= 0.0 ? 1.0 : -1.0; }

/* The branch of some joints at a pose. */
static branch_t branch_of(const links_t *links, place_t pose, const double *near) {
    vec_t wrist = wrist_of(links, pose);
    return (branch_t){sign_of(sin(near[0] - 0.5 * M_PI - atan2(wrist.y, wrist.x))),
                      sign_of(sin(near[4])), sign_of(sin(near[2]))};
}

/* One of the eight branches, those on which fewer of the first choices differ before others. */
static branch_t flipped(branch_t first, int flips) {
    return (branch_t){flips & 4 ? -first.shoulder : first.shoulder,
                      flips & 2 ? -first.wrist : first.wrist, flips & 1 ? -first.elbow : first.elbow};
}

/* Turn each joint by whole turns to be nearest to another angle; return the largest distance. */
static double turn_near(double *joints, const double *near) {
    double farthest = 0.0;
    for (int k = 0; k < ARM_JOINTS; k++) {
        joints[k] += TURN * rint((near[k] - joints[k]) / TURN);
        farthest = larger(fabs(joints[k] - near[k]), farthest);
    }
    return farthest;
}

/* The pose of the published arm for which this arm reaches a pose near some joints. */
static place_t goal_of(row_t arm, place_t pose, const double *joints) {
    if (!is_calibrated(arm))
        return pose;
    place_t here = flange_at(own(arm), joints), there = flange_at(published(arm), joints);
    quat_t turn = multiplied(pose.q, conjugated(here.q));
    return (place_t){multiplied(turn, there.q), plus(pose.p, turned(turn, minus(there.p, here.p)))};
}

/* How far some joints leave the flange from a pose, the larger one of rad and m. */
static double residual_of(row_t arm, place_t pose, const double *joints) {
    place_t here = flange_at(own(arm), joints);
    quat_t turn = multiplied(conjugated(pose.q), here.q);
    double angle = 2.0 * sqrt(turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
    vec_t gap = minus(here.p, pose.p);
    return larger(angle, sqrt(dot(gap, gap)));
}

/* Improve joints of the published arm to those of this one; false if they do not reach the pose. */
static bool settle(row_t arm, const links_t *links, place_t pose, double *joints) {
    for (int round = 0; is_calibrated(arm) && round < ROUNDS; round++) {
        place_t goal = goal_of(arm, pose, joints);
        double better[ARM_JOINTS];
        if (!solve(links, goal, branch_of(links, goal, joints), joints[5], better))
            return false;
        double step = turn_near(better, joints);
        memcpy(joints, better, sizeof better);
        if (step < SETTLED)
            break;
    }
    return !is_calibrated(arm) || residual_of(arm, pose, joints) <= REACHED;
}

/* The flange that carries a tool at a pose. */
static place_t flange_of(const double *tool, const double *pose) {
    place_t carried = place_at(tool), there = place_at(pose);
    quat_t q = multiplied(there.q, conjugated(carried.q));
    return (place_t){q, minus(there.p, turned(q, carried.p))};
}

index_t solve_arm(row_t arm, row_t tool, row_t pose, matrix_t joints) {
    links_t links = links_of(arm);
    place_t flange = flange_of(tool.v, pose.v);
    index_t found = 0;
    for (int flips = 0; flips < ARM_BRANCHES; flips++) {
        double *row = row_of(joints, found);
        if (solve(&links, flange, flipped((branch_t){1.0, 1.0, 1.0}, flips), 0.0, row))
            found += settle(arm, &links, flange, row);
    }
    return found;
}

/* The joints for the flange at a pose, nearest to some joints; false if it is out of reach. */
static bool nearest(row_t arm, const links_t *links, place_t pose, const double *near,
                    double *joints) {
    /* Near these joints, the error of the published table is nearly constant. */
    place_t goal = goal_of(arm, pose, near);
    branch_t first = branch_of(links, goal, near);
    double least_distance = INFINITY;
    for (int flips = 0; flips < ARM_BRANCHES && least_distance >= SAME_BRANCH; flips++) {
        double found[ARM_JOINTS];
        if (!solve(links, goal, flipped(first, flips), near[5], found))
            continue;
        double distance = turn_near(found, near);
        if (distance < least_distance) {
            least_distance = distance;
            memcpy(joints, found, sizeof found);
        }
    }
    return least_distance < INFINITY && settle(arm, links, pose, joints);
}

index_t follow_arm(row_t arm, row_t tool, matrix_t poses, row_t near, matrix_t joints) {
    links_t links = links_of(arm);
    const double *last = near.v;
    for (index_t i = 0; i < poses.n; i++) {
        place_t flange = flange_of(tool.v, row_of(poses, i));
        if (!nearest(arm, &links, flange, last, row_of(joints, i)))
            return i;
        last = row_of(joints, i);
    }
    return poses.n;
}

void reserve_arm(row_t arm, matrix_t joints, matrix_t reserves) {
    links_t links = links_of(arm);
    for (index_t i = 0; i < joints.n; i++) {
        const double *q = row_of(joints, i);
        double along = -links.upper_arm * cos(q[1]) - links.forearm * cos(q[1] + q[2])
                       + links.d5 * sin(q[1] + q[2] + q[3]);
        double *row = row_of(reserves, i);
        row[0] = fabs(sin(q[4])), row[1] = fabs(sin(q[2])), row[2] = fabs(along);
    }
}
