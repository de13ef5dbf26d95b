/* What the servo draws between the records of a block; see between.h. */
#include "between.h"
#include "differences.h"

/* Rows of a law. */
enum { CURVE_ROWS = 13 };

INLINE vec_t of_row(const double *restrict rows, index_t i, double scale) {
    return vec(scale * rows[i], scale * rows[BLOCK + i], scale * rows[2 * BLOCK + i]);
}

INLINE void to_row(double *restrict rows, index_t i, vec_t v) {
    rows[i] = v.x, rows[BLOCK + i] = v.y, rows[2 * BLOCK + i] = v.z;
}

static void put_curves(const double *restrict records, index_t count, double period,
                       const double *restrict turns, double *restrict curves) {
    const double *omega = records + 4 * BLOCK, *alpha = records + 7 * BLOCK;
    double square = period * period;
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        vec_t v = of_row(omega, i, period), w = of_row(omega, i + 1, period);
        vec_t a = of_row(alpha, i, square), b = of_row(alpha, i + 1, square);
        law_t law = law_between(of_row(turns, i, 1.0), v, w, a, b);
        to_row(curves, i, law.first);
        to_row(curves + 3 * BLOCK, i, law.second);
        to_row(curves + 6 * BLOCK, i, law.third);
        to_row(curves + 9 * BLOCK, i, law.step);
        curves[12 * BLOCK + i] = law.place;
    }
}

static void draw(const double *restrict records, index_t count, const double *restrict curves,
                 double u, double *restrict q) {
    INDEPENDENT
    for (index_t i = 0; i < count; i++) {
        law_t law = {of_row(curves, i, 1.0), of_row(curves + 3 * BLOCK, i, 1.0),
                     of_row(curves + 6 * BLOCK, i, 1.0), of_row(curves + 9 * BLOCK, i, 1.0),
                     curves[12 * BLOCK + i]};
        double c, s;
        quat_t here = quat(records[i], records[BLOCK + i], records[2 * BLOCK + i],
                           records[3 * BLOCK + i]);
        here = turned_by(here, law_value(law, u), &c, &s);
        q[i] = here.w, q[BLOCK + i] = here.x;
        q[2 * BLOCK + i] = here.y, q[3 * BLOCK + i] = here.z;
    }
}

void draw_between(const block_t *block, double period, const double *turns, seen_t *at) {
    double curves[CURVE_ROWS * BLOCK];
    index_t count = block->count - 1;
    put_curves(block->rows[0], count, period, turns, curves);
    for (int p = 1; p < PHASES; p++)
        draw(block->rows[0], count, curves, (double)p / PHASES, at[p].q[0]);
}
