/* Certifying as Python calls it. */
#include <math.h>

#include "between.h"
#include "binding.h"
#include "certify.h"
#include "trajectory.h"

/* Records a motion can have at most; more are no motion. */
#define MOST_RECORDS 1e15

static PyObject *answer(int failed, slowest_t found) {
    return failed ? PyErr_NoMemory() : Py_BuildValue("dL", found.rate, (long long)found.place);
}

/* The five arguments that the brake rate follows from. */
static bool is_law(const argument_t *a) {
    return a[0].m.n == 2 && a[1].v.n >= 2 && a[1].v.n <= INT32_MAX;
}

static brake_law_t law_of(const argument_t *a) {
    return (brake_law_t){a[0].m, a[1].v, a[2].d, a[3].d, a[4].d};
}

/* Where differences go: squares and places. */
static bool is_room(const argument_t *a) { return a[0].m.n == 6 && a[0].m.m == 4 && a[1].x.n == 12; }

static extremes_t room_of(const argument_t *a) { return (extremes_t){a[0].m.v, a[1].x.v}; }

static bool is_table(matrix_t limits, index_t rows) { return limits.n == rows && limits.m == 4; }

KERNEL(least_rate) {
    TAKE("mmvddmvddd");
    CHECK(a[0].m.n == a[2].v.n && a[1].m.n == a[2].v.n && a[0].m.m == a[1].m.m && is_law(a + 5));
    slowest_t found = {0.0, 0};
    int failed;
    RUN(failed = least_rate(a[0].m, a[1].m, a[2].v, a[3].d, a[4].d, law_of(a + 5), &found));
    return answer(failed, found);
}

/* here, there, periods, shares, out */
KERNEL(between) {
    TAKE("mmvvM");
    index_t n = a[0].m.n, m = a[0].m.m;
    CHECK(m == 7 || m == 10 || m == 16 || m == 19);
    CHECK(a[1].m.n == n && a[4].m.n == n && a[1].m.m == m && a[4].m.m == m);
    CHECK(a[2].v.n == n && a[3].v.n == n);
    RUN(between(a[0].m, a[1].m, a[2].v, a[3].v, a[4].m));
    Py_RETURN_NONE;
}

/* q, past, with_axes, period, start, rough, with_rate, most, the law, squares, places */
KERNEL(setpoint_extremes) {
    TAKE("mipddvpmmvdddMX");
    CHECK((a[0].m.n == 4 || a[0].m.n == 10) && a[1].i >= 0 && a[1].i <= 1 && a[5].v.n == 4);
    CHECK(is_table(a[7].m, 2) && is_law(a + 8) && is_room(a + 13));
    measure_t how = {a[2].p, a[6].p, a[3].d, a[5].v.v, a[7].m.v, law_of(a + 8)};
    slowest_t found;
    int failed;
    RUN(failed = setpoint_extremes(a[0].m, a[1].i, a[4].d, how, room_of(a + 13), &found));
    return answer(failed, found);
}

PyMethodDef certify_methods[] = {
    ENTRY(between), ENTRY(least_rate), ENTRY(setpoint_extremes), LAST_ENTRY,
};
