/* Joins and connectors as Python calls them. */
#include "binding.h"
#include "connectors.h"
#include "shorten.h"

static bool is_matrix(matrix_t a, index_t n, index_t m) { return a.n == n && a.m == m; }
static bool is_tensor(tensor_t a, index_t n, index_t m, index_t k) {
    return a.n == n && a.m == m && a.k == k;
}

KERNEL(try_joins) {
    TAKE("mmvvmTX");
    index_t n = a[2].v.n;
    CHECK(is_matrix(a[0].m, n, STATE) && is_matrix(a[1].m, n, STATE) && a[3].v.n == STATE);
    CHECK(is_matrix(a[4].m, 3, 4) && is_tensor(a[5].t, n, FACTORS, 3) && a[6].x.n == n);
    RUN(try_joins(a[0].m, a[1].m, a[2].v, a[3].v, a[4].m, a[5].t, a[6].x));
    Py_RETURN_NONE;
}

KERNEL(ramps_of_stop) {
    TAKE("vmdMTV");
    CHECK(a[0].v.n == STATE && is_matrix(a[1].m, 3, 4) && is_matrix(a[3].m, RAMPS, STATE));
    CHECK(is_tensor(a[4].t, RAMPS, FACTORS, 3) && a[5].v.n == RAMPS);
    index_t found;
    RUN(found = ramps_of_stop(a[0].v, a[1].m, a[2].d, a[3].m, a[4].t, a[5].v));
    return PyLong_FromLongLong(found);
}

KERNEL(find_connector) {
    TAKE("vvmdddMTV");
    CHECK(a[0].v.n == STATE && a[1].v.n == STATE && is_matrix(a[2].m, 3, 4));
    CHECK(is_matrix(a[6].m, 3, 4) && is_tensor(a[7].t, 3, FACTORS, 3) && a[8].v.n == 4);
    bool is_found;
    RUN(is_found = find_connector(a[0].v, a[1].v, a[2].m, a[3].d, a[4].d, a[5].d, a[6].m, a[7].t,
                                  a[8].v));
    return PyBool_FromLong(is_found);
}

KERNEL(guess_connector) {
    TAKE("vvmddddMTV");
    CHECK(a[0].v.n == STATE && a[1].v.n == STATE && is_matrix(a[2].m, 3, 4));
    CHECK(is_matrix(a[7].m, 3, 4) && is_tensor(a[8].t, 3, FACTORS, 3) && a[9].v.n == 4);
    RUN(guess_connector(a[0].v, a[1].v, a[2].m, a[3].d, a[4].d, a[5].d, a[6].d, a[7].m,
                        a[8].t, a[9].v));
    Py_RETURN_NONE;
}

KERNEL(shorten_connector) {
    TAKE("vvmdddddmtvMTV");
    CHECK(a[0].v.n == STATE && a[1].v.n == STATE && is_matrix(a[2].m, 3, 4));
    CHECK(is_matrix(a[8].m, 3, 4) && is_tensor(a[9].t, 3, FACTORS, 3) && a[10].v.n == 4);
    CHECK(is_matrix(a[11].m, ELEMENTS, 4) && is_tensor(a[12].t, ELEMENTS, FACTORS, 3));
    CHECK(a[13].v.n == ELEMENTS + 1);
    index_t found;
    RUN(found = shorten_connector(a[0].v, a[1].v, a[2].m, a[3].d, a[4].d, a[5].d, a[6].d, a[7].d,
                                  a[8].m, a[9].t, a[10].v, a[11].m, a[12].t, a[13].v));
    return PyLong_FromLongLong(found);
}

PyMethodDef connectors_methods[] = {
    ENTRY(try_joins),
    ENTRY(ramps_of_stop),
    ENTRY(find_connector),
    ENTRY(guess_connector),
    ENTRY(shorten_connector),
    LAST_ENTRY,
};
