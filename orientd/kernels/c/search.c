/* The increments of an interpolating cumulative B-spline: the search by Newton's method. */
#include <stdlib.h>
#include <string.h>

#include "increments.h"

enum {
    REACH = 12,    /* how far around a row that is far away others are approached, too */
    LOST_REACH = 6, /* the same of one that is lost on the way */
    MOST_STEPS = 30,
    MOST_ATTEMPTS = 2,
    PART = 1000, /* rows to be searched at a time: what is wanted of them stays in the cache */
    AHEAD = 30,  /* rows behind them without which their increments would lack digits */
};

/* The first correction must not be longer, in rad of half angle, and each must be a share of the
 * one before it, or the search is not under control. */
static const double LARGEST_FIRST = 1.2, CONTRACTION = 0.6;
static const double SMALLEST_GROWTH = 0.01;
/* How small a correction has to be before the full scale is reached. */
static const double ON_THE_WAY = 5e-2;
/* After a correction so small the next one, its square, is lost in rounding. */
static const double SETTLED = 1e-8;
static const double ROUNDING = 1e-7;
/* Longer increments of Euclidean space, in rad of half angle, are too far away to begin with. */
static const double LONGEST_FIRST = 1.8;
/* By which scales they are approached, and how much a correction there may move one, in rad. */
static const double APPROACH[] = {0.5, 0.75, 0.9, 1.0}, LARGEST_MOVE = 0.5;
/* After a longer last one rows are not where they should be. */
static const double LARGEST_LAST = 0.5;

/* What a search needs. */
typedef struct {
    double *memory;
    matrix_t tangent; /* the increments of Euclidean space */
    matrix_t here;    /* where the search is */
    bool *moves;      /* the rows that are searched, as for open_window */
    window_t window;  /* these rows */
    double reached[2]; /* the last scales, at which bend and bend_before are */
    index_t points;    /* how many of them there are */
} search_t;

/* The largest component; infinite where one is not a number. */
INLINE double size_of(vec_t v) {
    double a = fabs(v.x), b = fabs(v.y), c = fabs(v.z), size = a > b ? a : b;
    size = c > size ? c : size;
    return a + b + c < INFINITY ? size : INFINITY;
}

static void move_all(search_t *search, bool are_moving) {
    memset(search->moves, are_moving, (size_t)search->here.n);
}

/* Have the rows around one move. */
static void move_around(search_t *search, index_t row, index_t reach) {
    index_t begin = most(0, row - reach), end = least(search->here.n, row + reach + 1);
    memset(search->moves + begin, true, (size_t)(end - begin));
}

/* Have the rows move around those whose last correction was longer than a limit, and return whether
 * there are any. */
static bool move_far(search_t *search, double limit) {
    const window_t *window = &search->window;
    bool any = false;
    move_all(search, false);
    for (index_t i = 0, k = 0; i < LANES; i++)
        for (index_t p = 0; p < window->length && k < window->count; p++, k++)
            if (!(size_of(correction_at(window, i, p)) <= limit)) {
                move_around(search, window->which[k], LOST_REACH);
                any = true;
            }
    return any;
}

/* Improve the increments of the window until corrections are small enough, and return FOUND, or
 * NOT_FOUND where they do not shrink at some rows.
 *
 * limit: receives what the last ones of all others do not exceed. */
static int newton(search_t *search, double enough, double *limit) {
    double before = INFINITY;
    *limit = LARGEST_FIRST;
    for (index_t step = 0; step < MOST_STEPS; step++) {
        double size = newton_step(&search->window);
        if (!(size <= *limit))
            return NOT_FOUND;
        if (size <= enough || (size <= ROUNDING && size > 0.5 * before))
            return FOUND;
        *limit = fmax(CONTRACTION * size, ROUNDING);
        before = size;
    }
    *limit = INFINITY;
    return NOT_FOUND;
}

/* Points on the way of some increments from where nothing turns to the full scale, and how it is
 * carried on: w(s) = s w' + s^2 (c + s d), from what it is at the last one or two scales.  What
 * stands still follows by itself. */
static void begin_way(search_t *search) {
    window_t *window = &search->window;
    open_window(window, 1.0, search->here, search->moves);
    load_items(window, 1.0, search->tangent, window->tangent);
    memset(window->bend, 0, (size_t)window->length * sizeof *window->bend);
    for (index_t k = 0; k < window->ties; k++) {
        index_t p = window->tie[k].item % window->length, i = window->tie[k].item / window->length;
        for (index_t c = 0; c < 3; c++)
            window->bend[p][c][i] = window->w[p + 1][c][i] - window->tangent[p][c][i];
    }
    memcpy(window->bend_before, window->bend, (size_t)window->length * sizeof *window->bend);
    search->points = 0;
}

static void foresee(search_t *search, double next) {
    window_t *window = &search->window;
    const double *reached = search->reached;
    double ahead = search->points == 2 ? (next - reached[0]) / (reached[0] - reached[1]) : 0.0;
    double *restrict w = window->w[1][0];
    const double *bend = window->bend[0][0], *before = window->bend_before[0][0];
    const double *tangent = window->tangent[0][0];
    for (index_t k = 0; k < 3 * LANES * window->length; k++)
        w[k] = next * (tangent[k] + next * (bend[k] + ahead * (bend[k] - before[k])));
    put_targets(window, next);
}

static void note(search_t *search, double scale) {
    window_t *window = &search->window;
    double inverse = 1.0 / scale, *restrict bend = window->bend[0][0];
    double *restrict before = window->bend_before[0][0];
    const double *w = window->w[1][0], *tangent = window->tangent[0][0];
    for (index_t k = 0; k < 3 * LANES * window->length; k++) {
        before[k] = bend[k];
        bend[k] = (w[k] * inverse - tangent[k]) * inverse;
    }
    search->points = least(search->points + 1, 2);
    search->reached[1] = search->reached[0], search->reached[0] = scale;
}

/* Foresee the increments and correct them once, none of them by more than LARGEST_MOVE; return
 * the largest correction. */
static double move(search_t *search, double scale) {
    window_t *window = &search->window;
    foresee(search, scale);
    double largest = newton_step(window);
    if (largest <= LARGEST_LAST)
        return largest;
    foresee(search, scale);
    for (index_t i = 0; i < LANES; i++)
        for (index_t p = 0; p < window->length; p++) {
            vec_t d = correction_at(window, i, p);
            double size = size_of(d), share = size > LARGEST_MOVE ? LARGEST_MOVE / size : 1.0;
            lanes_t *w = window->w[p + 1];
            if (size < INFINITY)
                w[0][i] += share * d.x, w[1][i] += share * d.y, w[2][i] += share * d.z;
        }
    return largest;
}

/* Bring the increments of rows near their full scale: a correction at each of a few scales, which
 * only has to be good enough to foresee the next.
 *
 * Return whether there are rows that are not under control there, which are those that move then. */
static bool approach(search_t *search) {
    double largest = 0.0;
    begin_way(search);
    for (size_t step = 0; step < sizeof APPROACH / sizeof *APPROACH; step++) {
        largest = move(search, APPROACH[step]);
        note(search, APPROACH[step]);
    }
    close_window(&search->window, search->moves, search->here);
    return !(largest <= LARGEST_LAST) && move_far(search, LARGEST_LAST);
}

/* Carry the increments of rows from where nothing turns to the full scale with care, and return
 * whether that was possible. */
static bool march(search_t *search) {
    double scale = 0.0, growth = 0.5, limit;
    begin_way(search);
    while (scale < 1.0) {
        double next = fmin(1.0, scale + growth);
        foresee(search, next);
        if (newton(search, ON_THE_WAY, &limit) != FOUND) {
            growth = 0.5 * (next - scale);
            if (growth < SMALLEST_GROWTH)
                return false;
            continue;
        }
        note(search, next);
        growth = 2.0 * (next - scale);
        scale = next;
    }
    close_window(&search->window, search->moves, search->here);
    return true;
}

/* Newton's method from the increments of Euclidean space straight to the full steps, but for long
 * ones, which are approached.  Rows in the way are carried there with care: a correction decays by
 * 0.27 with each keyframe, so the others hardly take notice.  The solution is the one connected
 * with small rotations. */
static bool search_increments(search_t *search) {
    index_t count = search->here.n;
    bool any = false;
    move_all(search, false);
    for (index_t i = 0; i < count; i++)
        if (norm(vec_at(row_of(search->tangent, i))) > LONGEST_FIRST) {
            move_around(search, i, REACH);
            any = true;
        }
    if (any && approach(search))
        march(search);
    for (index_t attempt = 0;; attempt++) {
        double limit;
        move_all(search, true);
        open_window(&search->window, 1.0, search->here, search->moves);
        int found = newton(search, SETTLED, &limit);
        close_window(&search->window, search->moves, search->here);
        if (found == FOUND || attempt == MOST_ATTEMPTS || !move_far(search, limit))
            return found == FOUND;
        index_t width = 0;
        for (index_t i = 0; i < count; i++)
            width += search->moves[i];
        if (attempt || width > count / 2)
            move_all(search, true);
        if (!march(search))
            return false;
    }
}

/* The only unknown, where two increments are known at both ends: a logarithm, the principal one as
 * in the Hermite curve.  Whole turns added to the step are left to the search. */
static bool is_explicit(const equations_t *equations) {
    return equations->steps.n == 1 && equations->heads.n == 2 && equations->tails.n == 2
        && norm(vec_at(equations->steps.v)) <= M_PI;
}

/* Take what is known beyond one end off the equation of Euclidean space there. */
static void end_equation(matrix_t known, double ratio, double *share, double *middle, vec_t *step) {
    if (!known.n)
        *middle += *share * ratio;
    for (index_t i = 0; i < known.n; i++)
        *step = minus(*step, times(known.n == 1 ? *share : 1.0, vec_at(row_of(known, i))));
    *share = 0.0;
}

int euclidean_increments(const equations_t *equations, matrix_t unknown) {
    index_t count = equations->steps.n;
    double *above = malloc(sizeof(double) * (size_t)count), left_of = 0.0;
    if (!above)
        return OUT_OF_MEMORY;
    vec_t before = {0.0, 0.0, 0.0};
    for (index_t i = 0; i < count; i++) {
        const double *begun = row_of(equations->begun, i);
        double left = 1.0 - begun[0], middle = begun[2] - begun[1], right = begun[3];
        vec_t step = vec_at(row_of(equations->steps, i));
        if (i == 0)
            end_equation(equations->heads, equations->start_ratio, &left, &middle, &step);
        if (i == count - 1)
            end_equation(equations->tails, equations->end_ratio, &right, &middle, &step);
        double inverse = 1.0 / (middle - left * left_of);
        before = times(inverse, minus(step, times(left, before)));
        above[i] = left_of = inverse * right;
        put_vec(row_of(unknown, i), before);
    }
    for (index_t i = count - 2; i >= 0; i--) {
        double *v = row_of(unknown, i);
        put_vec(v, minus(vec_at(v), times(above[i], vec_at(v + 3))));
    }
    free(above);
    return FOUND;
}

/* Take memory for a search among so many rows, and return whether there was any. */
static bool new_search(const equations_t *equations, search_t *search) {
    size_t count = (size_t)equations->steps.n;
    search->memory = malloc(count * 3 * sizeof(double) + count + 4);
    if (!search->memory || !new_window(equations, &search->window)) {
        free(search->memory);
        return false;
    }
    search->tangent.v = search->memory;
    search->moves = (bool *)(search->memory + 3 * count) + 2;
    return true;
}

static void end_search(search_t *search) {
    free(search->window.memory);
    free(search->memory);
}

/* Search among the rows of other equations, no more than there is memory for. */
static void turn_to(search_t *search, const equations_t *equations, matrix_t unknown) {
    search->window.equations = equations, search->here = unknown;
    search->tangent = (matrix_t){search->tangent.v, unknown.n, 3};
    memset(search->moves - 2, false, (size_t)unknown.n + 4);
}

static int search_all(search_t *search, const equations_t *equations, matrix_t unknown) {
    turn_to(search, equations, unknown);
    int found = euclidean_increments(equations, search->tangent);
    if (found != FOUND)
        return found;
    memcpy(unknown.v, search->tangent.v, 3 * sizeof(double) * (size_t)unknown.n);
    return search_increments(search) ? FOUND : NOT_FOUND;
}

/* The equations of some neighbouring rows, the increments before them being known. */
static equations_t part_of(const equations_t *equations, matrix_t unknown, index_t begin,
                           index_t end) {
    equations_t part = *equations;
    part.steps = (matrix_t){row_of(equations->steps, begin), end - begin, 3};
    part.begun = (matrix_t){row_of(equations->begun, begin), end - begin + 1, 2};
    if (begin > 0)
        part.heads = (matrix_t){row_of(unknown, begin - 1), 1, 3};
    if (end < unknown.n)
        part.tails = (matrix_t){NULL, 0, 3}, part.end_ratio = 0.0;
    return part;
}

/* Return whether the increments before a row fit to those from it on. */
static bool join_parts(search_t *search, const equations_t *equations, matrix_t unknown,
                       index_t row) {
    index_t begin = most(0, row - REACH), end = least(unknown.n, row + REACH);
    equations_t part = part_of(equations, unknown, begin, end);
    if (end < unknown.n)
        part.tails = (matrix_t){row_of(unknown, end), 1, 3};
    turn_to(search, &part, (matrix_t){row_of(unknown, begin), end - begin, 3});
    move_all(search, true);
    open_window(&search->window, 1.0, search->here, search->moves);
    bool is_joined = newton_step(&search->window) <= ROUNDING;
    close_window(&search->window, search->moves, search->here);
    return is_joined;
}

index_t find_increments(const equations_t *equations, matrix_t unknown, index_t first) {
    if (is_explicit(equations)) {
        put_vec(unknown.v, end_step(equations, 1.0, 0));
        return 1;
    }
    index_t count = unknown.n - first, parts = (count + PART - 1) / PART;
    search_t search;
    equations_t longest = {.steps.n = least(count, count / parts + 1 + AHEAD)};
    if (!new_search(&longest, &search))
        return OUT_OF_MEMORY;
    int found = FOUND;
    index_t begin = first;
    for (index_t k = 1; k <= parts; k++) {
        index_t next = first + k * count / parts, end = least(unknown.n, next + AHEAD);
        equations_t part = part_of(equations, unknown, begin, end);
        found = search_all(&search, &part, (matrix_t){row_of(unknown, begin), end - begin, 3});
        if (found == FOUND && begin > 0 && !join_parts(&search, equations, unknown, begin))
            found = NOT_FOUND;
        if (found != FOUND)
            break;
        begin = next;
    }
    end_search(&search);
    return found == OUT_OF_MEMORY ? OUT_OF_MEMORY : begin;
}
