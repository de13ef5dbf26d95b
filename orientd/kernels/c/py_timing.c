/* Quickest timings as Python calls them. */
#include "binding.h"

#include <stdlib.h>

#include "clock.h"
#include "interpolation.h"
#include "profile.h"
#include "timing.h"
#include "trajectory.h"

static bool is_matrix(matrix_t a, index_t n, index_t m) { return a.n == n && a.m == m; }

static PyObject *bytes_of(const double *v, index_t n) {
    return PyBytes_FromStringAndSize((const char *)v, (Py_ssize_t)((size_t)n * sizeof *v));
}

KERNEL(time_quickest) {
    TAKE("vmvvpvmmvdvmm");
    index_t n = a[1].m.n, knots = a[2].v.n, edges = a[3].v.n, moves = a[6].m.n;
    CHECK(n > 0 && a[0].v.n == n + 1 && a[1].m.m == PIECE && knots > 1 && edges > 1);
    CHECK(edges == 2 || a[4].p);
    CHECK(a[5].v.n == (moves ? moves + 1 : 0) && a[6].m.m == 18);
    CHECK(is_matrix(a[7].m, 3, 4) && a[8].v.n == 2 && a[9].d > 0.0);
    index_t axes = a[12].m.m, axis_pieces = a[11].m.n;
    CHECK(axes <= MOST_AXES && (!axes || (a[12].m.n == 3 && axis_pieces)));
    CHECK(!axes || (a[10].v.n == axis_pieces + 1 && a[11].m.m == 6 * axes));
    timing_t asked = {a[0].v, a[1].m, a[2].v, a[3].v, a[4].p, a[5].v, a[6].m,
                      a[7].m, a[8].v, a[9].d, a[10].v, a[11].m, a[12].m};
    timed_t timed;
    int found;
    RUN(found = time_quickest(&asked, &timed));
    if (found == OUT_OF_MEMORY)
        return PyErr_NoMemory();
    if (found != TIMED)
        return PyBool_FromLong(found == STANDS_STILL);
    PyObject *made = Py_BuildValue("(NN)", bytes_of(timed.rows.v, PROFILE_ROWS * timed.rows.m),
                                   bytes_of(timed.parts, PART_NUMBERS * (edges - 1)));
    free(timed.rows.v), free(timed.parts);
    return made;
}

KERNEL(time_map) {
    TAKE("vvvvvvM");
    index_t n = a[0].v.n, size = a[5].v.n;
    CHECK(n > 1 && a[1].v.n == n && a[2].v.n == n && a[3].v.n == n && a[4].v.n == 2);
    CHECK(is_matrix(a[6].m, 3, size) || is_matrix(a[6].m, 1, size));
    clocked_t clock = {a[0].v, a[1].v, a[2].v, a[3].v, a[4].v};
    if (a[6].m.n == 3)
        RUN(sample_clock(&clock, a[5].v, a[6].m));
    else
        RUN(for (index_t i = 0; i < size; i++) a[6].m.v[i] = time_of(&clock, a[5].v.v[i]));
    Py_RETURN_NONE;
}

PyMethodDef timing_methods[] = {
    ENTRY(time_map),
    ENTRY(time_quickest),
    LAST_ENTRY,
};
