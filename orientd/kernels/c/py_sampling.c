/* Sampling of curves as Python calls it. */
#include "binding.h"
#include "sampling.h"

KERNEL(sample_cubic) {
    TAKE("vvmdM");
    CHECK(a[2].m.n == TABLE_ROWS && a[2].m.m > 0 && a[1].v.n == a[2].m.m + 1);
    CHECK(a[4].m.n == 10 && a[4].m.m == a[0].v.n);
    index_t place;
    RUN(place = sample_cubic(a[0].v, a[1].v, a[2].m, a[3].d, a[4].m));
    return PyLong_FromLongLong(place);
}

PyMethodDef sampling_methods[] = {
    ENTRY(sample_cubic),
    LAST_ENTRY,
};
