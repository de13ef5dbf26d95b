/* Sampling of curves as Python calls it. */
#include "binding.h"
#include "jets.h"
#include "sampling.h"

static bool is_tensor(tensor_t a, index_t n, index_t m, index_t k) {
    return a.n == n && a.m == m && a.k == k;
}

static bool is_basis(index_t spans, index_t m, tensor_t values, tensor_t rates,
                     tensor_t curvatures) {
    return is_tensor(values, spans, m, m + 1) && is_tensor(rates, spans, m, m)
           && is_tensor(curvatures, spans, m, most(m - 1, 1));
}

KERNEL(sample_product) {
    TAKE("vvmxmtM");
    index_t spans = a[1].v.n - 1, factors = a[5].t.m;
    CHECK(spans > 0 && factors > 0 && a[5].t.n == spans && a[5].t.k > 0);
    CHECK(a[2].m.n == spans && a[2].m.m == 4 && a[3].x.n == spans && a[4].m.m == 3);
    for (index_t s = 0; s < spans; s++)
        CHECK(a[3].x.v[s] >= 0 && a[3].x.v[s] <= a[4].m.n - factors);
    CHECK(a[6].m.n == a[0].v.n && a[6].m.m == 4);
    product_t product = {a[1].v, a[2].m, a[3].x, a[4].m, a[5].t};
    RUN(sample_product(a[0].v, product, a[6].m));
    Py_RETURN_NONE;
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

static bool are_rows(const argument_t *a, index_t n, index_t m) {
    for (int k = 0; k < 3; k++)
        if (a[k].m.n != n || a[k].m.m != m)
            return false;
    return true;
}

static bool are_scalars(const argument_t *a, index_t n) {
    return a[0].v.n == n && a[1].v.n == n && a[2].v.n == n;
}

static jets_t rows_at(const argument_t *a) { return (jets_t){a[0].m.v, a[1].m.v, a[2].m.v}; }
static jets_t scalars_at(const argument_t *a) { return (jets_t){a[0].v.v, a[1].v.v, a[2].v.v}; }
static jets_t parts_of(tensor_t t) {
    index_t size = t.m * t.k;
    return (jets_t){t.v, t.v + size, t.v + 2 * size};
}

KERNEL(jet_exponential) {
    TAKE("mmmT");
    index_t n = a[0].m.n;
    CHECK(are_rows(a, n, 3) && is_tensor(a[3].t, 3, n, 4));
    RUN(exponentials(n, rows_at(a), parts_of(a[3].t)));
    Py_RETURN_NONE;
}

KERNEL(jet_logarithm) {
    TAKE("mmmT");
    index_t n = a[0].m.n;
    CHECK(are_rows(a, n, 4) && is_tensor(a[3].t, 3, n, 3));
    RUN(logarithms(n, rows_at(a), parts_of(a[3].t)));
    Py_RETURN_NONE;
}

KERNEL(jet_slerp) {
    TAKE("mmmmmmvvvT");
    index_t n = a[0].m.n;
    CHECK(are_rows(a, n, 4) && are_rows(a + 3, n, 4) && are_scalars(a + 6, n));
    CHECK(is_tensor(a[9].t, 3, n, 4));
    RUN(slerps(n, rows_at(a), rows_at(a + 3), scalars_at(a + 6), parts_of(a[9].t)));
    Py_RETURN_NONE;
}

KERNEL(jet_geodesic) {
    TAKE("mmvvvT");
    index_t n = a[0].m.n;
    CHECK(a[0].m.m == 4 && a[1].m.n == n && a[1].m.m == 3 && are_scalars(a + 2, n));
    CHECK(is_tensor(a[5].t, 3, n, 4));
    RUN(geodesics(n, a[0].m.v, a[1].m.v, scalars_at(a + 2), parts_of(a[5].t)));
    Py_RETURN_NONE;
}

PyMethodDef sampling_methods[] = {
    ENTRY(sample_product),
    ENTRY(fill_basis),
    ENTRY(jet_exponential),
    ENTRY(jet_logarithm),
    ENTRY(jet_slerp),
    ENTRY(jet_geodesic),
    LAST_ENTRY,
};
