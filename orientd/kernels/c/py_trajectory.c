/* Trajectories as Python calls them. */
#include "binding.h"
#include "trajectory.h"

KERNEL(fit_trajectory) {
    TAKE("tMM");
    index_t n = a[0].t.n;
    CHECK(a[0].t.m == INSTANTS && a[0].t.k == 4);
    CHECK(a[1].m.n == n && a[1].m.m == PIECE && a[2].m.n == n && a[2].m.m == 2);
    RUN(fit_trajectory(a[0].t, a[1].m, a[2].m));
    Py_RETURN_NONE;
}

KERNEL(sample_trajectory) {
    TAKE("vvmdM");
    index_t rows = a[4].m.n;
    CHECK(a[2].m.n > 0 && a[2].m.m == PIECE && a[1].v.n == a[2].m.n + 1);
    CHECK((rows == 4 || rows == 10 || rows == 13) && a[4].m.m == a[0].v.n);
    index_t place;
    RUN(place = sample_trajectory(a[0].v, a[1].v, a[2].m, a[3].d, a[4].m));
    return PyLong_FromLongLong(place);
}

PyMethodDef trajectory_methods[] = {
    ENTRY(fit_trajectory),
    ENTRY(sample_trajectory),
    LAST_ENTRY,
};
