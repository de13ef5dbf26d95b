/* Arms, chains of axes within their limits, and forecasts of targets, as Python calls them. */
#include "arms.h"
#include "binding.h"
#include "chain.h"
#include "fit.h"
#include "vector.h"

static bool is_arm(row_t arm) { return arm.n == PUBLISHED_ARM || arm.n == CALIBRATED_ARM; }

KERNEL(place_arm) {
    TAKE("vpvM");
    CHECK(is_arm(a[0].v) && a[2].v.n == ARM_JOINTS);
    CHECK(a[3].m.n == ARM_JOINTS && a[3].m.m == ARM_POSE);
    RUN_AT_ONCE(place_arm(a[0].v, a[1].p, a[2].v, a[3].m));
    Py_RETURN_NONE;
}

KERNEL(solve_arm) {
    TAKE("vvvM");
    CHECK(is_arm(a[0].v) && a[1].v.n == ARM_POSE && a[2].v.n == ARM_POSE);
    CHECK(a[3].m.n == ARM_BRANCHES && a[3].m.m == ARM_JOINTS);
    index_t found;
    RUN_AT_ONCE(found = solve_arm(a[0].v, a[1].v, a[2].v, a[3].m));
    return PyLong_FromLongLong(found);
}

KERNEL(follow_arm) {
    TAKE("vvmvM");
    CHECK(is_arm(a[0].v) && a[1].v.n == ARM_POSE && a[3].v.n == ARM_JOINTS);
    CHECK(a[2].m.m == ARM_POSE && a[4].m.n >= a[2].m.n && a[4].m.m == ARM_JOINTS);
    index_t reached;
    RUN_AT_ONCE(reached = follow_arm(a[0].v, a[1].v, a[2].m, a[3].v, a[4].m));
    return PyLong_FromLongLong(reached);
}

KERNEL(reserve_arm) {
    TAKE("vmM");
    CHECK(is_arm(a[0].v) && a[1].m.m == ARM_JOINTS);
    CHECK(a[2].m.n >= a[1].m.n && a[2].m.m == ARM_RESERVES);
    RUN_AT_ONCE(reserve_arm(a[0].v, a[1].m, a[2].m));
    Py_RETURN_NONE;
}

static bool is_chain(row_t chain, matrix_t axes) {
    return axes.n > 0 && axes.n <= MOST_COORDINATES && axes.m == AXIS_LIMITS
           && chain.n == CHAIN_POSE + CHAIN_AXIS * axes.n;
}

KERNEL(pursue_joints) {
    TAKE("vmvdmmpvVVV");
    limited_chain_t arm = {a[0].v, a[1].m, a[2].v, a[3].d};
    CHECK(is_chain(arm.chain, arm.axes) && arm.tool.n == TOOL_LIMITS && arm.period > 0.0);
    CHECK(a[4].m.n == JOINT_ROWS && a[4].m.m == arm.axes.n && a[5].m.m == arm.axes.n);
    CHECK(a[5].m.n == 1 || (a[5].m.n == REFERENCE_ROWS && !a[6].p));
    CHECK(a[7].v.n == FOLLOWING && a[8].v.n == TAKEN);
    CHECK(a[9].v.n == arm.axes.n && a[10].v.n == arm.axes.n);
    RUN_AT_ONCE(
        pursue_joints(&arm, a[4].m, a[5].m, a[6].p, a[7].v, a[8].v, a[9].v, a[10].v));
    Py_RETURN_NONE;
}

KERNEL(roll_stop) {
    TAKE("vmvdmvmddvMV");
    limited_chain_t arm = {a[0].v, a[1].m, a[2].v, a[3].d};
    CHECK(is_chain(arm.chain, arm.axes) && arm.tool.n == TOOL_LIMITS && arm.period > 0.0);
    CHECK(a[4].m.n == JOINT_ROWS && a[4].m.m == arm.axes.n && a[5].v.n == TOOL_DIFFERENCES);
    CHECK(a[6].m.m == CONE && a[9].v.n == arm.axes.n && a[10].m.m == arm.axes.n);
    CHECK(a[11].v.n == STRAIN);
    index_t cycles;
    RUN_AT_ONCE(cycles = roll_stop(&arm, a[4].m, a[5].v, a[6].m, a[7].d, a[8].d, a[9].v, a[10].m,
                                   a[11].v));
    return PyLong_FromLongLong(cycles);
}

KERNEL(brakes_outside) {
    TAKE("vmmdm");
    CHECK(is_chain(a[0].v, a[1].m) && a[2].m.n == 2 && a[2].m.m == a[1].m.n);
    CHECK(a[3].d > 0.0 && a[4].m.m == CONE);
    bool is_outside;
    RUN_AT_ONCE(is_outside = brakes_outside(a[0].v, a[1].m, a[2].m, a[3].d, a[4].m));
    return PyBool_FromLong(is_outside);
}

static bool is_moving_vector(arguments_t *taken, int reference) {
    argument_t *a = taken->at;
    return a[0].v.n == VECTOR_LIMITS && a[1].d > 0.0 && a[2].v.n == VECTOR_STATE
           && a[reference].v.n == VECTOR_STATE;
}

KERNEL(pursue_vector) {
    TAKE("vdvvvVV");
    CHECK(is_moving_vector(&taken, 3) && a[4].v.n == VECTOR_FOLLOWING);
    CHECK(a[5].v.n == RATES && a[6].v.n == 3);
    bool is_linear;
    RUN_AT_ONCE(
        is_linear = pursue_vector(a[0].v, a[1].d, a[2].v, a[3].v, a[4].v, a[5].v, a[6].v));
    return PyBool_FromLong(is_linear);
}

KERNEL(halt_vector) {
    TAKE("vdvvV");
    CHECK(a[0].v.n == VECTOR_LIMITS && a[1].d > 0.0 && a[2].v.n == VECTOR_STATE);
    CHECK(a[3].v.n == 3 && a[4].v.n == 3);
    RUN_AT_ONCE(halt_vector(a[0].v, a[1].d, a[2].v, a[3].v, a[4].v));
    Py_RETURN_NONE;
}

KERNEL(stop_clearance) {
    TAKE("vdvm");
    CHECK(a[0].v.n == VECTOR_LIMITS && a[1].d > 0.0 && a[2].v.n == VECTOR_STATE);
    CHECK(a[3].m.m == CONE);
    double least;
    RUN_AT_ONCE(least = stop_clearance(a[0].v, a[1].d, a[2].v, a[3].m));
    return PyFloat_FromDouble(least);
}

static bool is_table(matrix_t table, index_t columns) {
    return table.n == FITS && table.m == columns;
}

KERNEL(fit_samples) {
    TAKE("mdM");
    CHECK(a[0].m.n > 0 && (a[0].m.m == FIT_SAMPLE || a[0].m.m == FIT_SAMPLE_WITH_RATE));
    CHECK(is_table(a[2].m, FIT_NUMBERS));
    RUN_AT_ONCE(fit_samples(a[0].m, a[1].d, a[2].m));
    Py_RETURN_NONE;
}

KERNEL(score_fits) {
    TAKE("mdvdM");
    CHECK(is_table(a[0].m, FIT_NUMBERS) && a[2].v.n == 3 && is_table(a[4].m, FIT_SCORE));
    RUN_AT_ONCE(score_fits(a[0].m, a[1].d, a[2].v, a[3].d, a[4].m));
    Py_RETURN_NONE;
}

KERNEL(mix_fits) {
    TAKE("mmV");
    CHECK(is_table(a[0].m, FIT_NUMBERS) && is_table(a[1].m, FIT_SCORE));
    CHECK(a[2].v.n == FIT_NUMBERS);
    RUN_AT_ONCE(mix_fits(a[0].m, a[1].m, a[2].v));
    Py_RETURN_NONE;
}

KERNEL(read_fit) {
    TAKE("vdV");
    CHECK(a[0].v.n == FIT_NUMBERS && a[2].v.n == FORECAST);
    RUN_AT_ONCE(read_fit(a[0].v, a[1].d, a[2].v));
    Py_RETURN_NONE;
}

PyMethodDef mechanism_methods[] = {
    ENTRY(brakes_outside), ENTRY(fit_samples),    ENTRY(follow_arm),   ENTRY(halt_vector),
    ENTRY(mix_fits),       ENTRY(place_arm),      ENTRY(pursue_joints), ENTRY(pursue_vector),
    ENTRY(read_fit),       ENTRY(reserve_arm),    ENTRY(roll_stop),    ENTRY(score_fits),
    ENTRY(solve_arm),      ENTRY(stop_clearance),
    LAST_ENTRY,
};
