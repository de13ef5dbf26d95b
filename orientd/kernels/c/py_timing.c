/* Quickest timings as Python calls them. */
#include "binding.h"
#include "clock.h"
#include "interpolation.h"
#include "knot_times.h"
#include "profile.h"

static bool is_matrix(matrix_t a, index_t n, index_t m) { return a.n == n && a.m == m; }

KERNEL(find_profile) {
    TAKE("vmmmmmvmppddVM");
    index_t n = a[0].v.n, places = 2 * n + 1;
    CHECK(n > 1 && is_matrix(a[1].m, places, 3) && is_matrix(a[2].m, places, 3));
    CHECK(!a[3].m.n || is_matrix(a[3].m, places, 3));
    CHECK(is_matrix(a[4].m, a[3].m.n, a[3].m.m) && is_matrix(a[5].m, 3, 4) && a[6].v.n == 2);
    CHECK(is_matrix(a[7].m, 3, n) && a[12].v.n == n + 2 && is_matrix(a[13].m, 3, n));
    profile_path_t path = {a[0].v, a[1].m, a[2].m, a[3].m, a[4].m,
                           a[5].m, a[6].v, a[7].m, a[8].p, a[9].p};
    int found;
    RUN(found = find_profile(&path, a[10].d, a[11].d, a[12].v, a[13].m));
    return found == OUT_OF_MEMORY ? PyErr_NoMemory() : PyBool_FromLong(found);
}

KERNEL(choose_knots) {
    TAKE("mvmdiiVVM");
    index_t n = a[0].m.n, pieces = a[4].i;
    CHECK(n > 2 && a[0].m.m == 4 && a[1].v.n == n - 1 && is_matrix(a[2].m, 3, 4));
    CHECK(pieces > 0 && pieces <= INT32_MAX && a[6].v.n == n);
    CHECK(a[7].v.n == (n - 1) * pieces + 2 && is_matrix(a[8].m, 3, (n - 1) * pieces));
    knots_t asked = {a[0].m, a[1].v, a[2].m, a[3].d, pieces, a[5].i};
    int found;
    RUN(found = choose_knots(asked, a[6].v, a[7].v, a[8].m));
    return found == OUT_OF_MEMORY ? PyErr_NoMemory() : PyBool_FromLong(found == FOUND);
}

KERNEL(put_node_times) {
    TAKE("vvvV");
    index_t n = a[0].v.n;
    CHECK(n > 1 && a[1].v.n == n && a[2].v.n == n && a[3].v.n == n);
    RUN(put_node_times(a[0].v, a[1].v, a[2].v, a[3].v));
    Py_RETURN_NONE;
}

KERNEL(leave_rest) {
    TAKE("vvdM");
    CHECK(a[1].v.n == 2 && is_matrix(a[3].m, 3, a[0].v.n));
    RUN(leave_rest(a[0].v, a[1].v, a[2].d, a[3].m));
    Py_RETURN_NONE;
}

KERNEL(sample_clock) {
    TAKE("vvvvvvM");
    index_t n = a[0].v.n;
    CHECK(n > 1 && a[1].v.n == n && a[2].v.n == n && a[3].v.n == n);
    CHECK(a[4].v.n == 2 && is_matrix(a[6].m, 3, a[5].v.n));
    RUN(sample_clock(a[0].v, a[1].v, a[2].v, a[3].v, a[4].v, a[5].v, a[6].m));
    Py_RETURN_NONE;
}

PyMethodDef timing_methods[] = {
    ENTRY(choose_knots),
    ENTRY(find_profile),
    ENTRY(put_node_times),
    ENTRY(leave_rest),
    ENTRY(sample_clock),
    LAST_ENTRY,
};
