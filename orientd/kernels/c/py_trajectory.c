/* Trajectories, and quintics along with them, as Python calls them. */
#include "binding.h"
#include "quintic.h"
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

static bool is_room(const argument_t *a) {
    return a[1].m.n > 0 && a[1].m.m == PIECE && a[0].v.n == a[1].m.n + 1;
}

/* the product (breaks, base, first, increments, values), given, cuts, ends, out */
KERNEL(product_trajectory) {
    TAKE("vmxmtmiVM");
    index_t spans = a[0].v.n - 1, factors = a[4].t.m, cuts = a[6].i, found;
    CHECK(spans > 0 && factors > 0 && a[4].t.n == spans && a[4].t.k > 1);
    CHECK(a[1].m.n == spans && a[1].m.m == 4 && a[2].x.n == spans && a[3].m.m == 3);
    for (index_t s = 0; s < spans; s++)
        CHECK(a[2].x.v[s] >= 0 && a[2].x.v[s] <= a[3].m.n - factors);
    CHECK(a[5].m.n == 4 && a[5].m.m == 3 && cuts > 0 && is_room(a + 7));
    product_t product = {a[0].v, a[1].m, a[2].x, a[3].m, a[4].t};
    RUN(found = product_trajectory(&product, a[5].m.v, cuts, a[7].v, a[8].m));
    return PyLong_FromLongLong(found);
}

/* breaks, pieces, the clock (times, places, values, slopes, leaves), ends, out */
KERNEL(retime_trajectory) {
    TAKE("vmvvvvvVM");
    index_t n = a[2].v.n, found;
    CHECK(is_room(a) && is_room(a + 7) && n > 1 && a[6].v.n == 2);
    CHECK(a[3].v.n == n && a[4].v.n == n && a[5].v.n == n);
    clocked_t clock = {a[2].v, a[3].v, a[4].v, a[5].v, a[6].v};
    RUN(found = retime_trajectory(a[0].v, a[1].m, &clock, a[7].v, a[8].m));
    return PyLong_FromLongLong(found);
}

/* intervals, ends (values, first and second derivatives, one after the other), coefficients */
KERNEL(put_quintics) {
    TAKE("vvV");
    index_t spans = a[0].v.n, knots = 3 * (spans + 1), m = a[1].v.n / knots;
    CHECK(a[1].v.n == knots * m && a[2].v.n == spans * QUINTIC * m);
    for (index_t k = 0; k < spans; k++)
        for (index_t i = 0; i < m; i++) {
            double ends[2][3];
            for (int side = 0; side < 2; side++)
                for (int order = 0; order < 3; order++)
                    ends[side][order] = a[1].v.v[(order * (spans + 1) + k + side) * m + i];
            put_quintic(a[0].v.v[k], ends[0], ends[1], a[2].v.v + k * QUINTIC * m + i, m);
        }
    release(&taken);
    Py_RETURN_NONE;
}

/* of three numbers */
KERNEL(quintic_at) {
    TAKE("vd");
    CHECK(a[0].v.n == 3 * QUINTIC);
    double x[4], y[4], z[4], u = a[1].d;
    const double *c = a[0].v.v;
    quintic_at(c, 3, u, x), quintic_at(c + 1, 3, u, y), quintic_at(c + 2, 3, u, z);
    release(&taken);
    return Py_BuildValue("((ddd)(ddd)(ddd)(ddd))", x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2],
                         z[2], x[3], y[3], z[3]);
}

KERNEL(sample_moves) {
    TAKE("vvmT");
    index_t n = a[0].v.n, each = 3 * n;
    CHECK(a[2].m.n > 0 && a[2].m.m == 3 * QUINTIC && a[1].v.n == a[2].m.n + 1);
    CHECK(a[3].t.n == 3 && a[3].t.m == n && a[3].t.k == 3);
    double *to = a[3].t.v;
    RUN(for (index_t i = 0; i < n; i++)
            put_move(a[1].v, a[2].m, a[0].v.v[i],
                     (move_t){to + 3 * i, to + each + 3 * i, to + 2 * each + 3 * i}));
    Py_RETURN_NONE;
}

PyMethodDef trajectory_methods[] = {
    ENTRY(fit_trajectory),
    ENTRY(product_trajectory),
    ENTRY(put_quintics),
    ENTRY(quintic_at),
    ENTRY(retime_trajectory),
    ENTRY(sample_moves),
    ENTRY(sample_trajectory),
    LAST_ENTRY,
};
