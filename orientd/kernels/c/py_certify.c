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

/* is it a turn, breaks, pieces, rows, before, count, held, rests at both ends, period, limits, first
 * column and end, tolerance, the law, found */
KERNEL(certify) {
    TAKE("pvmmmiippdmiidmvvV");
    bool is_turn = a[0].p;
    index_t columns = is_turn ? TURN_ROWS : PLAIN_ROWS, pieces = a[2].m.n, records = a[5].i;
    CHECK(records > 0 && records <= MOST_SETPOINTS && a[6].i >= 0 && a[6].i <= HISTORY && a[9].d > 0.0);
    CHECK(a[3].m.n ? a[3].m.n >= records && a[3].m.m == columns
                   : pieces > 0 && a[2].m.m == (is_turn ? PIECE : MOVE) && a[1].v.n == pieces + 1);
    CHECK(a[4].m.n <= HISTORY && (a[4].m.m == columns || a[4].m.n == 0));
    CHECK(a[10].m.n >= (is_turn ? 3 : 2) && a[10].m.n <= 3 && a[10].m.m == 4 && is_law(a + 14));
    CHECK(a[11].i >= 0 && a[11].i < a[12].i && a[12].i <= 4 && a[17].v.n == EXTREMES);
    setpoints_t from = {is_turn, a[1].v, a[2].m, a[3].m, a[4].m,
                        0, records, a[6].i, a[9].d, a[9].d, {a[7].p, a[8].p}};
    measure_t how = {a[10].m, (int)a[11].i, (int)a[12].i, a[13].d, law_of(a + 14)};
    int failed;
    RUN(failed = certify(&from, &how, (extremes_t *)a[17].v.v));
    return failed ? PyErr_NoMemory() : Py_NewRef(Py_None);
}

PyMethodDef certify_methods[] = {
    ENTRY(between), ENTRY(certify), LAST_ENTRY,
};
