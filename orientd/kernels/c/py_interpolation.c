/* Interpolation as Python calls it. */
#include "binding.h"
#include "interpolation.h"
#include "sampling.h"

/* Return whether something was found, or say that there is no memory. */
static PyObject *outcome(int found) {
    return found == OUT_OF_MEMORY ? PyErr_NoMemory() : PyBool_FromLong(found == FOUND);
}

/* Return how many were found, or say that there is no memory. */
static PyObject *count_of(index_t found) {
    return found == OUT_OF_MEMORY ? PyErr_NoMemory() : PyLong_FromLongLong(found);
}

static bool are_vectors(matrix_t a, index_t count) { return a.n == count && a.m == 3; }

static bool are_known(matrix_t a) { return a.n <= 2 && a.m == 3; }

static bool are_between(indices_t numbers, index_t count) {
    for (index_t i = 0; i < numbers.n; i++)
        if (numbers.v[i] < 0 || numbers.v[i] >= count)
            return false;
    return true;
}

static bool are_increasing(indices_t rows) {
    for (index_t i = 1; i < rows.n; i++)
        if (rows.v[i] <= rows.v[i - 1])
            return false;
    return true;
}

/* The equations that the first six arguments hold: steps, begun, heads, tails and two ratios. */
static equations_t equations_of(const argument_t *a) {
    return (equations_t){a[0].m, a[1].m, a[2].m, a[3].m, a[4].d, a[5].d};
}

static bool are_equations(const argument_t *a) {
    index_t count = a[0].m.n;
    return count > 0 && are_vectors(a[0].m, count) && a[1].m.n == count + 1 && a[1].m.m == 2
        && are_known(a[2].m) && are_known(a[3].m);
}

KERNEL(keyframe_errors) {
    TAKE("mmmmdddmxM");
    CHECK(are_equations(a) && are_vectors(a[7].m, a[0].m.n) && are_vectors(a[9].m, a[8].x.n));
    CHECK(are_between(a[8].x, a[0].m.n) && are_increasing(a[8].x));
    equations_t equations = equations_of(a);
    int found;
    RUN(found = keyframe_errors(&equations, a[6].d, a[7].m, a[8].x, a[9].m));
    if (found == OUT_OF_MEMORY)
        return PyErr_NoMemory();
    Py_RETURN_NONE;
}

KERNEL(keyframe_step) {
    TAKE("mmmmdddmxmM");
    CHECK(are_equations(a) && are_vectors(a[7].m, a[0].m.n) && are_vectors(a[10].m, a[8].x.n));
    CHECK(are_between(a[8].x, a[0].m.n) && are_increasing(a[8].x));
    CHECK(a[9].m.n == 0 || are_vectors(a[9].m, a[8].x.n));
    equations_t equations = equations_of(a);
    int found;
    RUN(found = keyframe_step(&equations, a[6].d, a[7].m, a[8].x, a[9].m, a[10].m));
    if (found == OUT_OF_MEMORY)
        return PyErr_NoMemory();
    Py_RETURN_NONE;
}

KERNEL(euclidean_increments) {
    TAKE("mmmmddM");
    CHECK(are_equations(a) && are_vectors(a[6].m, a[0].m.n));
    equations_t equations = equations_of(a);
    int found;
    RUN(found = euclidean_increments(&equations, a[6].m));
    return outcome(found);
}

KERNEL(find_increments) {
    TAKE("mmmmddMi");
    CHECK(are_equations(a) && are_vectors(a[6].m, a[0].m.n));
    CHECK(a[7].i >= 0 && a[7].i < a[0].m.n);
    equations_t equations = equations_of(a);
    index_t found;
    RUN(found = find_increments(&equations, a[6].m, a[7].i));
    return count_of(found);
}

KERNEL(are_unit) {
    TAKE("md");
    CHECK(a[0].m.m == 4);
    bool found;
    RUN(found = are_unit(a[0].m, a[1].d));
    return PyBool_FromLong(found);
}

KERNEL(put_steps) {
    TAKE("mM");
    CHECK(a[0].m.n > 0 && a[0].m.m == 4 && are_vectors(a[1].m, a[0].m.n - 1));
    RUN(put_steps(a[0].m, a[1].m));
    Py_RETURN_NONE;
}

/* Whether a spline through so many keyframes has so many spans. */
static bool fits(index_t keyframes, index_t start_known, index_t end_known, index_t spans) {
    return keyframes > 1 && start_known >= 0 && start_known <= 2 && end_known >= 0
        && end_known <= 2 && spans == keyframes - 1 + (start_known == 2) + (end_known == 2);
}

static bool is_pair(tensor_t a) { return a.n == 2 && a.m == 2 && a.k == 3; }

KERNEL(put_equations) {
    TAKE("vtiiVMTV");
    CHECK(is_pair(a[1].t) && fits(a[0].v.n, a[2].i, a[3].i, a[4].v.n - 1));
    CHECK(a[5].m.n == a[0].v.n && a[5].m.m == 2 && is_pair(a[6].t) && a[7].v.n == 2);
    RUN(put_equations(a[0].v, a[1].t, a[2].i, a[3].i, a[4].v, a[5].m, a[6].t, a[7].v));
    Py_RETURN_NONE;
}

KERNEL(put_table) {
    TAKE("mpvmM");
    index_t spans = a[4].m.m, between = spans - (a[0].m.n - 1);
    CHECK(a[0].m.n > 1 && a[0].m.m == 4 && between >= a[1].p && between <= 2);
    CHECK(a[2].v.n == spans + 1 && are_vectors(a[3].m, spans + 2) && a[4].m.n == TABLE_ROWS);
    int found;
    RUN(found = put_table(a[0].m, a[1].p, a[2].v, a[3].m, a[4].m));
    return outcome(found);
}

KERNEL(interpolate_c2) {
    TAKE("mvtiiVMM");
    index_t spans = a[6].m.m;
    CHECK(a[0].m.m == 4 && a[1].v.n == a[0].m.n && is_pair(a[2].t));
    CHECK(fits(a[0].m.n, a[3].i, a[4].i, spans) && a[5].v.n == spans + 1);
    CHECK(a[6].m.n == TABLE_ROWS && are_vectors(a[7].m, spans + 2));
    index_t found;
    RUN(found = interpolate_c2(a[0].m, a[1].v, a[2].t, a[3].i, a[4].i, a[5].v, a[6].m, a[7].m));
    return count_of(found);
}

KERNEL(solve_banded) {
    TAKE("miiM");
    CHECK(a[1].i >= 0 && a[2].i >= 0 && a[0].m.n == a[1].i + a[2].i + 1 && a[3].m.n == a[0].m.m);
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

PyMethodDef interpolation_methods[] = {
    ENTRY(are_unit),
    ENTRY(euclidean_increments),
    ENTRY(find_increments),
    ENTRY(interpolate_c2),
    ENTRY(keyframe_errors),
    ENTRY(keyframe_step),
    ENTRY(linearise_effort),
    ENTRY(put_equations),
    ENTRY(put_steps),
    ENTRY(put_table),
    ENTRY(solve_banded),
    LAST_ENTRY,
};
