/* The increments of an interpolating cumulative B-spline: the search by Newton's method. */
#include <stdlib.h>
#include <string.h>

#include "increments.h"

enum {
    REACH = 12, /* how far around a row that still moves others are corrected, too */
    MOST_STEPS = 30,
    MOST_ATTEMPTS = 2,
};

/* The first correction must not be longer, in rad of half angle, and each must be a share of the
 * one before it, or the search is not under control. */
static const double LARGEST_FIRST = 1.2, CONTRACTION = 0.6;
static const double SMALLEST_GROWTH = 0.01;
/* How small a correction has to be before the full scale is reached. */
static const double ON_THE_WAY = 1e-2;
/* After a correction so small the next one, its square, is lost in rounding. */
static const double SETTLED = 1e-8;
static const double ROUNDING = 1e-7;
/* Longer increments of Euclidean space, in rad of half angle, are too far away to begin with. */
static const double LONGEST_FIRST = 1.8;
/* By which scales they are approached, and how much a correction there may move one, in rad. */
static const double APPROACH[] = {0.4, 0.6, 0.75, 0.9, 1.0}, LARGEST_MOVE = 0.5;
/* After a longer last one rows are not where they should be. */
static const double LARGEST_LAST = 0.2;

/* What a search needs: increments and corrections, shape (N, 3) each, and lists of rows. */
typedef struct {
    const equations_t *equations;
    matrix_t tangent; /* the increments of Euclidean space */
    matrix_t here;    /* where the search is */
    double *bend, *bend_before, *trial, *correction;
    int64_t *rows, *window, *some;
    strands_t *strands;
    double reached[2]; /* the last scales, at which bend and bend_before are */
    index_t points;    /* how many of them there are */
} search_t;

/* The largest component; infinite where one is not a number. */
INLINE double size_of(const double *v) {
    double a = fabs(v[0]), b = fabs(v[1]), c = fabs(v[2]), size = a > b ? a : b;
    size = c > size ? c : size;
    return a + b + c < INFINITY ? size : INFINITY;
}

/* Write those rows of a list that are within reach of some of them; both lists are increasing. */
static index_t around(const int64_t *some, index_t found, const int64_t *rows, index_t count,
                      int64_t *to) {
    index_t next = 0, kept = 0;
    for (index_t i = 0; i < count; i++) {
        int64_t row = rows[i];
        while (next < found && some[next] < row - REACH)
            next++;
        if (next < found && some[next] <= row + REACH)
            to[kept++] = row;
    }
    return kept;
}

static void list_all(int64_t *rows, index_t count) {
    for (index_t i = 0; i < count; i++)
        rows[i] = i;
}

/* List rows that are within reach of some of them as the window, and return how many there are. */
static index_t near(search_t *search, index_t found) {
    list_all(search->rows, search->here.n);
    return around(search->some, found, search->rows, search->here.n, search->window);
}

/* Improve the increments of the first rows in the list until corrections are small enough, and
 * return how many rows are in the way, which are listed then; -1 if there is no end to it. */
static index_t newton(search_t *search, matrix_t unknown, double scale, index_t count,
                      double enough) {
    double limit = LARGEST_FIRST, before = INFINITY;
    for (index_t step = 0; step < MOST_STEPS; step++) {
        double size = newton_step(search->equations, scale, unknown,
                                  (indices_t){search->rows, count}, search->strands,
                                  search->correction);
        index_t bad = 0, moving = 0;
        if (!(size <= limit))
            for (index_t i = 0; i < count; i++) {
                search->some[bad] = search->rows[i];
                bad += !(size_of(search->correction + 3 * i) <= limit);
            }
        for (index_t i = 0; i < count; i++) {
            double *w = row_of(unknown, search->rows[i]);
            const double *d = search->correction + 3 * i;
            w[0] += d[0], w[1] += d[1], w[2] += d[2];
        }
        if (bad)
            return bad;
        if (size <= enough || (size <= ROUNDING && size > 0.5 * before))
            return 0;
        for (index_t i = 0; i < count; i++) {
            search->some[moving] = search->rows[i];
            moving += !(size_of(search->correction + 3 * i) <= enough);
        }
        count = around(search->some, moving, search->rows, count, search->rows);
        limit = fmax(CONTRACTION * size, ROUNDING);
        before = size;
    }
    return -1;
}

/* Points on the way of some increments from where nothing turns to the full scale, and how it is
 * carried on: w(s) = s w' + s^2 (c + s d), from what it is at the last one or two scales. */
static void begin_way(search_t *search, index_t count) {
    index_t size = 3 * search->here.n;
    for (index_t k = 0; k < size; k++)
        search->bend[k] = search->here.v[k] - search->tangent.v[k];
    for (index_t i = 0; i < count; i++)
        put_vec(search->bend + 3 * search->window[i], vec(0.0, 0.0, 0.0));
    memcpy(search->bend_before, search->bend, sizeof(double) * (size_t)size);
    search->points = 0;
}

static void foresee(search_t *search, double next) {
    const double *reached = search->reached;
    double ahead = search->points == 2 ? (next - reached[0]) / (reached[0] - reached[1]) : 0.0;
    for (index_t k = 0; k < 3 * search->here.n; k++) {
        double bend = search->bend[k] + ahead * (search->bend[k] - search->bend_before[k]);
        search->trial[k] = next * (search->tangent.v[k] + next * bend);
    }
}

static void note(search_t *search, double scale, index_t count) {
    double inverse = 1.0 / scale;
    for (index_t i = 0; i < count; i++)
        for (index_t k = 3 * search->window[i]; k < 3 * search->window[i] + 3; k++) {
            search->bend_before[k] = search->bend[k];
            search->bend[k] = (search->trial[k] * inverse - search->tangent.v[k]) * inverse;
        }
    search->points = least(search->points + 1, 2);
    search->reached[1] = search->reached[0], search->reached[0] = scale;
}

static void arrive(search_t *search, index_t count) {
    for (index_t i = 0; i < count; i++)
        put_vec(row_of(search->here, search->window[i]),
                vec_at(search->trial + 3 * search->window[i]));
}

/* Correct the rows of the window once, none of them by more than LARGEST_MOVE, and return how many
 * were to move by more than LARGEST_LAST, which are listed. */
static index_t move(search_t *search, matrix_t unknown, double scale, index_t count) {
    index_t lost = 0;
    double largest = newton_step(search->equations, scale, unknown,
                                 (indices_t){search->window, count}, search->strands,
                                 search->correction);
    for (index_t i = 0; i < count; i++) {
        const double *d = search->correction + 3 * i;
        double *w = row_of(unknown, search->window[i]);
        if (largest <= LARGEST_LAST) {
            w[0] += d[0], w[1] += d[1], w[2] += d[2];
            continue;
        }
        double size = size_of(d), share = size > LARGEST_MOVE ? LARGEST_MOVE / size : 1.0;
        search->some[lost] = search->window[i];
        lost += size > LARGEST_LAST;
        if (size < INFINITY)
            put_vec(w, scaled_plus(share, vec_at(d), vec_at(w)));
    }
    return lost;
}

/* Bring the increments of a window of rows near their full scale: a correction at each of a few
 * scales, which only has to be good enough to foresee the next.  Those beyond follow by themselves.
 *
 * Return how many rows are not under control there, which are listed. */
static index_t approach(search_t *search, index_t count) {
    matrix_t trial = {search->trial, search->here.n, 3};
    index_t lost = 0;
    begin_way(search, count);
    for (size_t step = 0; step < sizeof APPROACH / sizeof *APPROACH; step++) {
        foresee(search, APPROACH[step]);
        lost = move(search, trial, APPROACH[step], count);
        note(search, APPROACH[step], count);
    }
    arrive(search, count);
    return lost;
}

/* Carry the increments of a window of rows from where nothing turns to the full scale with care,
 * and return whether that was possible. */
static bool march(search_t *search, index_t count) {
    matrix_t trial = {search->trial, search->here.n, 3};
    double scale = 0.0, growth = 0.5;
    begin_way(search, count);
    while (scale < 1.0) {
        double next = fmin(1.0, scale + growth);
        foresee(search, next);
        memcpy(search->rows, search->window, sizeof *search->rows * (size_t)count);
        if (newton(search, trial, next, count, ON_THE_WAY)) {
            growth = 0.5 * (next - scale);
            if (growth < SMALLEST_GROWTH)
                return false;
            continue;
        }
        note(search, next, count);
        growth = 2.0 * (next - scale);
        scale = next;
    }
    arrive(search, count);
    return true;
}

/* Newton's method from the increments of Euclidean space straight to the full steps, but for long
 * ones, which are approached.  Rows in the way are carried there with care: a correction decays by
 * 0.27 with each keyframe, so the others hardly take notice.  The solution is the one connected
 * with small rotations. */
static bool search_increments(search_t *search) {
    index_t count = search->here.n, far = 0;
    for (index_t i = 0; i < count; i++) {
        search->some[far] = i;
        far += norm(vec_at(row_of(search->tangent, i))) > LONGEST_FIRST;
    }
    if (far) {
        index_t lost = approach(search, near(search, far));
        if (lost)
            march(search, near(search, lost));
    }
    for (index_t attempt = 0;; attempt++) {
        list_all(search->rows, count);
        index_t bad = newton(search, search->here, 1.0, count, SETTLED);
        if (bad <= 0 || attempt == MOST_ATTEMPTS)
            return bad == 0;
        index_t width = near(search, bad);
        if (attempt || width > count / 2)
            list_all(search->window, width = count);
        if (!march(search, width))
            return false;
    }
}

/* The only unknown, where two increments are known at both ends: a logarithm, the principal one as
 * in the Hermite curve.  Whole turns added to the step are left to the search. */
static bool is_explicit(const equations_t *equations) {
    return equations->steps.n == 1 && equations->heads.n == 2 && equations->tails.n == 2
        && norm(vec_at(equations->steps.v)) <= M_PI;
}

int find_increments(const equations_t *equations, matrix_t unknown) {
    if (is_explicit(equations)) {
        put_vec(unknown.v, end_step(equations, 1.0, 0));
        return FOUND;
    }
    size_t count = (size_t)equations->steps.n;
    void *rest;
    strands_t *strands = new_strands(
        SHORT_RUN, count * (15 * sizeof(double) + 3 * sizeof(int64_t)), &rest);
    if (!strands)
        return OUT_OF_MEMORY;
    double *memory = rest;
    int64_t *lists = (int64_t *)(memory + 15 * count);
    search_t search = {
        .equations = equations, .strands = strands,
        .tangent = {memory, unknown.n, 3}, .here = unknown, .correction = memory + 3 * count,
        .bend = memory + 6 * count, .bend_before = memory + 9 * count,
        .trial = memory + 12 * count,
        .rows = lists, .some = lists + count, .window = lists + 2 * count,
    };
    int found = euclidean_increments(equations, search.tangent);
    if (found == FOUND) {
        memcpy(unknown.v, search.tangent.v, 3 * count * sizeof(double));
        found = search_increments(&search) ? FOUND : NOT_FOUND;
    }
    free(strands);
    return found;
}
