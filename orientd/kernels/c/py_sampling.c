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
    ENTRY(fill_basis),
    LAST_ENTRY,
};
