/* Interpolation as Python calls it. */
#include "binding.h"
#include "interpolation.h"
#include "sampling.h"

/* Return whether something was found, or say that there is no memory. */
static PyObject *outcome(int found) {
    return found == OUT_OF_MEMORY ? PyErr_NoMemory() : PyBool_FromLong(found == FOUND);
}

static bool are_vectors(matrix_t a, index_t count) { return a.n == count && a.m == 3; }

static bool are_between(indices_t numbers, index_t count) {
    for (index_t i = 0; i < numbers.n; i++)
        if (numbers.v[i] < 0 || numbers.v[i] >= count)
            return false;
    return true;
}

static bool is_known(index_t known, index_t order) {
    return known == 0 || (known == 1 && order < 5) || (known == 2 && order > 3);
}

KERNEL(interpolate) {
    TAKE("mmvitiipVMMT");
    index_t n = a[0].m.n, order = a[3].i;
    CHECK(n > 1 && a[0].m.m == 4 && (a[1].m.n == 0 || are_vectors(a[1].m, n - 1)));
    CHECK(a[2].v.n == n && order >= 3 && order <= 6);
    CHECK(a[4].t.n == 2 && a[4].t.m == 2 && a[4].t.k == 3);
    CHECK(is_known(a[5].i, order) && is_known(a[6].i, order));
    interpolation_t asked = {a[0].m, a[1].m, a[2].v, order, a[4].t, {a[5].i, a[6].i}, a[7].p};
    index_t spans = spans_of(&asked);
    CHECK(a[8].v.n == spans + 1 && a[9].m.n == spans && a[9].m.m == 4);
    CHECK(are_vectors(a[10].m, spans + order - 2));
    CHECK(a[11].t.n == spans && a[11].t.m == order - 1 && a[11].t.k == order);
    int found;
    RUN(found = interpolate(&asked, a[8].v, a[9].m, a[10].m, a[11].t));
    return outcome(found);
}

KERNEL(solve_banded) {
    TAKE("miiM");
    CHECK(a[1].i >= 0 && a[2].i >= 0 && a[1].i < a[0].m.n);
    CHECK(a[2].i == a[0].m.n - 1 - a[1].i && a[3].m.n == a[0].m.m);
    int found;
    RUN(found = solve_banded(a[0].m, a[1].i, a[2].i, a[3].m));
    return outcome(found);
}

KERNEL(linearise_effort) {
    TAKE("mxtvmxmmMTTM");
    index_t increments = a[0].m.n, factors = a[2].t.m, size = 3 * factors, spans = a[8].m.n;
    index_t rows = a[6].m.n, bound = a[6].m.m;
    CHECK(spans > 0 && factors > 0 && factors <= MOST_FACTORS && a[0].m.m == 3);
    CHECK(a[1].x.n == spans * factors && are_between(a[1].x, increments));
    CHECK(a[2].t.n == 3 && a[2].t.k == a[3].v.n && a[3].v.n % spans == 0);
    CHECK(a[4].m.n == 0 || are_vectors(a[4].m, 3));
    CHECK(a[5].x.n == rows * bound && are_between(a[5].x, increments));
    CHECK(a[7].m.n == rows && a[7].m.m == 4 && a[8].m.m == size);
    CHECK(a[9].t.n == spans && a[9].t.m == size && a[9].t.k == size);
    CHECK(a[10].t.n == rows && a[10].t.m == 3 && a[10].t.k == 3 * bound);
    CHECK(are_vectors(a[11].m, rows));
    double effort;
    RUN(effort = linearise_effort(a[0].m, a[1].x, a[2].t, a[3].v, a[4].m, a[5].x, a[6].m, a[7].m,
                                  a[8].m, a[9].t, a[10].t, a[11].m));
    return PyFloat_FromDouble(effort);
}

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

PyMethodDef interpolation_methods[] = {
    ENTRY(fill_basis),
    ENTRY(interpolate),
    ENTRY(linearise_effort),
    ENTRY(solve_banded),
    LAST_ENTRY,
};
