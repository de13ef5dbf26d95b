/* Arms, and the foresight of axes, as Python calls them. */
#include "arms.h"
#include "binding.h"
#include "foresight.h"

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

KERNEL(foresee_stop) {
    TAKE("vVM");
    CHECK(a[0].v.n == COMING_STOP && a[1].v.n > 2);
    CHECK(a[2].m.n == a[1].v.n && a[2].m.m == ARM_POSE);
    index_t poses;
    RUN_AT_ONCE(poses = foresee_stop((const coming_stop_t *)a[0].v.v, a[1].v, a[2].m));
    return PyLong_FromLongLong(poses);
}

KERNEL(first_strain) {
    TAKE("vmmmdV");
    index_t axes = a[1].m.m;
    CHECK(a[0].v.n >= a[1].m.n && a[2].m.n == 2 && a[2].m.m == axes);
    CHECK(a[3].m.n == axes && a[3].m.m == 4 && a[5].v.n == STRAIN);
    index_t row;
    RUN_AT_ONCE(row = first_strain(a[0].v, a[1].m, a[2].m, a[3].m, a[4].d, a[5].v));
    return PyLong_FromLongLong(row);
}

PyMethodDef mechanism_methods[] = {
    ENTRY(first_strain), ENTRY(follow_arm),  ENTRY(foresee_stop),
    ENTRY(place_arm),    ENTRY(reserve_arm), ENTRY(solve_arm),
    LAST_ENTRY,
};
