/* Sampling of curves as Python calls it. */
#include "binding.h"
#include "sampling.h"

static bool is_tensor(tensor_t a, index_t n, index_t m, index_t k) {
    return a.n == n && a.m == m && a.k == k;
}

static bool is_basis(index_t spans, index_t m, tensor_t values, tensor_t rates,
                     tensor_t curvatures) {
    return is_tensor(values, spans, m, m + 1) && is_tensor(rates, spans, m, m)
           && is_tensor(curvatures, spans, m, most(m - 1, 1));
}

KERNEL(sample_cubic) {
    TAKE("vvmdM");
    CHECK(a[2].m.n == TABLE_ROWS && a[2].m.m > 0 && a[1].v.n == a[2].m.m + 1);
    CHECK(a[4].m.n == 10 && a[4].m.m == a[0].v.n);
    index_t place;
    RUN(place = sample_cubic(a[0].v, a[1].v, a[2].m, a[3].d, a[4].m));
    return PyLong_FromLongLong(place);
}

KERNEL(sample_product) {
    TAKE("vvmtmtttdM");
    index_t spans = a[1].v.n - 1, m = a[4].m.n;
    CHECK(spans > 0 && m > 0 && a[2].m.n == 4 && a[2].m.m == spans && a[4].m.m == spans);
    CHECK(is_tensor(a[3].t, m, 3, spans) && is_basis(spans, m, a[5].t, a[6].t, a[7].t));
    CHECK(a[9].m.n == 10 && a[9].m.m == a[0].v.n);
    index_t place;
    RUN(place = sample_product(a[0].v, a[1].v, a[2].m, a[3].t, a[4].m, a[5].t, a[6].t, a[7].t,
                               a[8].d, a[9].m));
    return place == OUT_OF_MEMORY ? PyErr_NoMemory() : PyLong_FromLongLong(place);
}

KERNEL(fill_basis) {
    TAKE("xviTTT");
    index_t order = a[2].i;
    CHECK(order >= 2 && order <= a[1].v.n / 2);
    CHECK(is_basis(a[0].x.n, order - 1, a[3].t, a[4].t, a[5].t));
    for (index_t s = 0; s < a[0].x.n; s++)
        CHECK(a[0].x.v[s] >= order - 1 && a[0].x.v[s] < a[1].v.n - order);
    int failed;
    RUN(failed = fill_basis(a[0].x, a[1].v, order, a[3].t, a[4].t, a[5].t));
    if (failed)
        return PyErr_NoMemory();
    Py_RETURN_NONE;
}

PyMethodDef sampling_methods[] = {
    ENTRY(sample_cubic),
    ENTRY(sample_product),
    ENTRY(fill_basis),
    LAST_ENTRY,
};
