/* Rows of the equations of a spline, side by side as strands want them. */
#include <stdlib.h>

#include "increments.h"
#include "lanes.h"

enum { ALIGNMENT = 64 /* bytes: of the widest vectors */ };

/* Places of the strands of so many items. */
static index_t length_of(index_t count) {
    return count <= ALONE ? count : most((count + LANES - 1) / LANES, OVERLAP);
}

bool new_window(const equations_t *equations, window_t *window) {
    size_t items = (size_t)equations->steps.n + 2;
    size_t length = (size_t)most(ALONE, length_of(equations->steps.n + 2)), places = length + 2;
    /* One place more around the system, into which rows of the strands beside it reach. */
    size_t before = OVERLAP + 1, lanes = places * (3 + 2) + length * (3 + 4 + 3 + 3 * 3)
                    + 30 * (length + 2) + 12 * (length + 2 * before);
    size_t size = lanes * sizeof(lanes_t) + items * (sizeof(int64_t) + sizeof(tie_t))
                  + sizeof(int64_t) + 2 * sizeof(tie_t);
    char *memory = aligned_alloc(ALIGNMENT, (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT);
    if (!memory)
        return false;
    lanes_t *next = (lanes_t *)memory;
    window->memory = memory, window->equations = equations;
    window->w = (lanes_t (*)[3])next, next += 3 * places;
    window->shares = (lanes_t (*)[2])next, next += 2 * places;
    window->step = (lanes_t (*)[3])next, next += 3 * length;
    window->target = (lanes_t (*)[4])next, next += 4 * length;
    window->error = (lanes_t (*)[3])next, next += 3 * length;
    window->tangent = (lanes_t (*)[3])next, next += 3 * length;
    window->bend = (lanes_t (*)[3])next, next += 3 * length;
    window->bend_before = (lanes_t (*)[3])next, next += 3 * length;
    window->system = (lanes_t (*)[30])next + 1, next += 30 * (length + 2);
    window->kept = (lanes_t (*)[12])next + before, next += 12 * (length + 2 * before);
    window->tie = (tie_t *)next;
    window->which = (int64_t *)(window->tie + items + 2);
    return true;
}

/* List the items, and which of them stand still or follow. */
static void list_items(window_t *window, const bool *moves) {
    const equations_t *equations = window->equations;
    index_t last = equations->steps.n, count = 0, ties = 0;
    for (index_t j = -1; j <= last; j++) {
        window->which[count] = j;
        window->tie[ties] = (tie_t){count, 0.0, 0.0};
        bool is_there = moves[j - 1] | moves[j] | moves[j + 1];
        count += is_there, ties += is_there & !moves[j];
    }
    if (ties && window->which[0] == -1 && !equations->heads.n)
        window->tie[0].of_after = equations->start_ratio;
    if (ties && window->which[count - 1] == last && !equations->tails.n)
        window->tie[ties - 1].of_before = equations->end_ratio;
    window->count = count, window->length = length_of(count);
    /* What is left over would hang on the last item. */
    if (count < LANES * window->length)
        window->tie[ties++] = (tie_t){count, 0.0, 0.0};
    window->ties = ties;
}

/* The first or last step: what two known increments turn is taken off. */
vec_t end_step(const equations_t *equations, double scale, index_t row) {
    vec_t step = times(scale, vec_at(row_of(equations->steps, row)));
    bool off_start = row == 0 && equations->heads.n == 2;
    bool off_end = row == equations->steps.n - 1 && equations->tails.n == 2;
    if (!off_start && !off_end)
        return step;
    quat_t rest = exponential(step);
    for (index_t i = 0; off_start && i < 2; i++)
        rest = multiplied(exponential(times(-scale, vec_at(row_of(equations->heads, i)))), rest);
    for (index_t i = 0; off_end && i < 2; i++)
        rest = multiplied(rest, exponential(times(-scale, vec_at(row_of(equations->tails, i)))));
    return logarithm(rest);
}

void put_targets(window_t *window, double scale) {
    index_t length = window->length, last = window->equations->steps.n - 1;
    for (index_t p = 0; p < length; p++) {
        lanes_t *restrict step = window->step[p], *restrict target = window->target[p];
        INDEPENDENT
        for (index_t i = 0; i < LANES; i++) {
            double x = step[0][i], y = step[1][i], z = step[2][i], c, s;
            double turn = norm(vec(x, y, z)), inverse = turn > 0.0 ? 1.0 / turn : 0.0;
            cosine_and_sine(scale * turn, &c, &s);
            target[0][i] = c, s *= inverse;
            target[1][i] = s * x, target[2][i] = s * y, target[3][i] = s * z;
        }
    }
    /* The ends are among the first and last two items. */
    for (index_t k = 0; k < window->count; k++) {
        k = k == 2 ? most(k, window->count - 2) : k;
        index_t row = window->which[k];
        if (row != 0 && row != last)
            continue;
        quat_t q = exponential(end_step(window->equations, scale, row));
        lanes_t *to = window->target[k % length];
        index_t i = k / length;
        to[0][i] = q.w, to[1][i] = q.x, to[2][i] = q.y, to[3][i] = q.z;
    }
}

/* The increment before the first unknown, or after the last one. */
static vec_t beyond(matrix_t known, double ratio, double scale, const double *next) {
    return known.n ? times(scale, vec_at(row_of(known, known.n - 1))) : times(ratio, vec_at(next));
}

void load_items(const window_t *window, double scale, matrix_t from, lanes_t (*to)[3]) {
    const equations_t *equations = window->equations;
    index_t length = window->length, last = from.n - 1;
    vec_t first = beyond(equations->heads, equations->start_ratio, scale, from.v);
    vec_t final = beyond(equations->tails, equations->end_ratio, scale, row_of(from, last));
    for (index_t i = 0; i < LANES; i++)
        for (index_t p = 0; p < length; p++) {
            index_t item = i * length + p, j = item < window->count ? window->which[item] : 0;
            vec_t v = item >= window->count ? vec(0.0, 0.0, 0.0)
                    : j < 0 ? first : j > last ? final : vec_at(row_of(from, j));
            to[p][0][i] = v.x, to[p][1][i] = v.y, to[p][2][i] = v.z;
        }
}

void open_window(window_t *window, double scale, matrix_t unknown, const bool *moves) {
    list_items(window, moves);
    const equations_t *equations = window->equations;
    index_t last = equations->steps.n, length = window->length;
    for (index_t i = 0; i < LANES; i++)
        for (index_t p = 0; p < length; p++) {
            index_t item = i * length + p;
            index_t j = item < window->count ? window->which[item] : last + 1;
            lanes_t *to = window->shares[p + 1];
            to[0][i] = j >= 0 && j <= last ? row_of(equations->begun, j)[1] : 0.0;
            to[1][i] = j < last ? row_of(equations->begun, j + 1)[0] : 1.0;
        }
    load_items(window, scale, equations->steps, window->step);
    load_items(window, scale, unknown, window->w + 1);
    put_targets(window, scale);
}

void close_window(const window_t *window, const bool *moves, matrix_t unknown) {
    index_t length = window->length;
    for (index_t i = 0; i < LANES; i++)
        for (index_t p = 0; p < length && i * length + p < window->count; p++) {
            index_t j = window->which[i * length + p];
            lanes_t *w = window->w[p + 1];
            if (moves[j])
                put_vec(row_of(unknown, j), vec(w[0][i], w[1][i], w[2][i]));
        }
}
