/* Certifying as Python calls it. */
#include "between.h"
#include "binding.h"
#include "certify.h"
#include "trajectory.h"

/* The three arguments that the brake rate follows from. */
static bool is_law(const argument_t *a) {
    return a[0].m.n == 2 && a[1].v.n >= 2 && a[1].v.n <= INT32_MAX && a[2].v.n == 3;
}

static brake_law_t law_of(const argument_t *a) {
    return (brake_law_t){a[0].m, a[1].v, a[2].v.v[0], a[2].v.v[1], a[2].v.v[2]};
}

KERNEL(least_rate) {
    TAKE("mmvddmvv");
    CHECK(a[0].m.n == a[2].v.n && a[1].m.n == a[2].v.n && a[0].m.m == a[1].m.m && is_law(a + 5));
    slowest_t found = {0.0, 0};
    int failed;
    RUN(failed = least_rate(a[0].m, a[1].m, a[2].v, a[3].d, a[4].d, law_of(a + 5), &found));
    return failed ? PyErr_NoMemory() : Py_BuildValue("dL", found.rate, (long long)found.place);
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

/* breaks, pieces, the position (breaks, moves, place), rows, before, count, held, rests at both ends,
 * period, limits, move_limits, tolerance, the law, found */
KERNEL(certify) {
    TAKE("vmvmvmmiippdmvdmvvV");
    index_t pieces = a[1].m.n, moves = a[3].m.n, records = a[7].i;
    CHECK(records > 0 && records <= MOST_SETPOINTS && a[8].i >= 0 && a[8].i <= HISTORY && a[11].d > 0.0);
    CHECK(a[5].m.n ? a[5].m.n >= records && a[5].m.m == STATE_ROWS
                   : pieces > 0 && a[1].m.m == PIECE && a[0].v.n == pieces + 1);
    CHECK(a[2].v.n == (moves ? moves + 1 : 0) && a[3].m.m == 18 && a[4].v.n == 3);
    CHECK(a[6].m.n <= HISTORY && a[6].m.m == STATE_ROWS);
    CHECK(a[12].m.n == 3 && a[12].m.m == 4 && a[13].v.n == 2 && is_law(a + 15));
    CHECK(a[18].v.n == EXTREMES);
    setpoints_t from = {a[0].v, a[1].m, a[2].v, a[3].m, a[4].v, a[5].m, a[6].m,
                        0, records, a[8].i, a[11].d, a[11].d, {a[9].p, a[10].p}};
    measure_t how = {a[12].m, a[13].v, a[14].d, law_of(a + 15)};
    int failed;
    RUN(failed = certify(&from, &how, (extremes_t *)a[18].v.v));
    return failed ? PyErr_NoMemory() : Py_NewRef(Py_None);
}

/* q, order, reach, parts, out */
KERNEL(turn_sizes) {
    TAKE("miiiM");
    index_t order = a[1].i, reach = a[2].i, parts = a[3].i;
    CHECK(a[0].m.m == 4 && a[4].m.m == 4 && order >= 1 && order <= HISTORY);
    CHECK(parts > 0 && parts <= MOST_PARTS && reach > 0 && reach <= MOST_PARTS);
    CHECK(order * reach <= a[0].m.n);
    int failed;
    RUN(failed = turn_sizes(a[0].m, order, reach, parts, a[4].m));
    return failed ? PyErr_NoMemory() : Py_NewRef(Py_None);
}

PyMethodDef certify_methods[] = {
    ENTRY(between), ENTRY(least_rate), ENTRY(turn_sizes), ENTRY(certify), LAST_ENTRY,
};
