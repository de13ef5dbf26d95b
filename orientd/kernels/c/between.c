/* States between records; see between.h. */
#include "between.h"

/* (1 - u) a + u b */
INLINE vec_t mixed(vec_t a, vec_t b, double u) { return plus(times(1.0 - u, a), times(u, b)); }

void between(matrix_t here, matrix_t there, row_t periods, row_t shares, matrix_t out) {
    index_t columns = here.m;
    for (index_t i = 0; i < here.n; i++) {
        const double *p = row_of(here, i), *q = row_of(there, i);
        double *to = row_of(out, i), h = periods.v[i], u = shares.v[i], c, s;
        vec_t turn = times(2.0, logarithm(shorter(multiplied(conjugated(quat_at(p)), quat_at(q)))));
        vec_t v = times(h, vec_at(p + 4)), w = times(h, vec_at(q + 4));
        law_t law = columns < 10 ? hermite(turn, v, right_jacobian_inverse(turn, w))
                  : law_between(turn, v, w, times(h * h, vec_at(p + 7)),
                                times(h * h, vec_at(q + 7)));
        vec_t r = law_value(law, u);
        put_quat(to, turned_by(quat_at(p), r, &c, &s));
        put_vec(to + 4, times(1.0 / h, right_jacobian(r, c, s, law_rate(law, u))));
        if (columns >= 10)
            put_vec(to + 7, mixed(vec_at(p + 7), vec_at(q + 7), u));
        if (columns >= 16) {
            vec_t way = minus(vec_at(q + 10), vec_at(p + 10));
            law_t travel = hermite(way, times(h, vec_at(p + 13)), times(h, vec_at(q + 13)));
            put_vec(to + 10, plus(vec_at(p + 10), law_value(travel, u)));
            put_vec(to + 13, times(1.0 / h, law_rate(travel, u)));
        }
        if (columns >= 19)
            put_vec(to + 16, mixed(vec_at(p + 16), vec_at(q + 16), u));
    }
}
