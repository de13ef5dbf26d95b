/* Connectors, stops and motion along a line as Python calls them. */
#include "binding.h"
#include "connectors.h"
#include "double_s.h"
#include "shorten.h"
#include "trajectory.h"

static bool is_matrix(matrix_t a, index_t n, index_t m) { return a.n == n && a.m == m; }

static bool is_table(row_t breaks, matrix_t pieces) {
    return is_matrix(pieces, breaks.n - 1, PIECE) && pieces.n > 0;
}

KERNEL(connect) {
    TAKE("vvmmdddddVM");
    CHECK(a[0].v.n == STATE && a[1].v.n == STATE && is_matrix(a[2].m, 3, 4));
    CHECK(is_matrix(a[3].m, 3, 4) && a[4].d > 0.0 && is_table(a[9].v, a[10].m));
    index_t found;
    RUN(found = connect_states(a[0].v, a[1].v, a[2].m, a[3].m, a[4].d, a[5].d, a[6].d, a[7].d,
                               a[8].d, a[9].v, a[10].m));
    return PyLong_FromLongLong(found);
}

KERNEL(stop) {
    TAKE("vmddVM");
    CHECK(a[0].v.n == STATE && is_matrix(a[1].m, 3, 4) && is_table(a[4].v, a[5].m));
    index_t found;
    RUN(found = stop_from(a[0].v, a[1].m, a[2].d, a[3].d, a[4].v, a[5].m));
    return PyLong_FromLongLong(found);
}

KERNEL(double_s) {
    TAKE("dddd");
    double t[3];
    double_s(a[0].d, a[1].d, a[2].d, a[3].d, t);
    return Py_BuildValue("(ddd)", t[0], t[1], t[2]);
}

KERNEL(stop_along) {
    TAKE("dddd");
    line_stop_t found = stop_along(a[0].d, a[1].d, a[2].d, a[3].d);
    return Py_BuildValue("(dd)", found.time, found.way);
}

KERNEL(first_change) {
    TAKE("dd");
    return PyFloat_FromDouble(first_change(a[0].d, a[1].d));
}

PyMethodDef connectors_methods[] = {
    ENTRY(connect),
    ENTRY(double_s),
    ENTRY(first_change),
    ENTRY(stop),
    ENTRY(stop_along),
    LAST_ENTRY,
};
