/* Meshes of a path and their refinement; see timing.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "quintic.h"
#include "profile.h"
#include "timing.h"
#include "trajectory.h"

enum {
    MOST_ROUNDS = 6,        /* of ever narrower elements */
    FEWEST_ROUNDS = 2,
    BUDGET = 420,           /* elements of all rounds together */
    BUDGET_OF_INTERVAL = 5, /* and for each interval between knots */
    PIECES_OF_INTERVAL = 10,
    FEWEST_PIECES = 100,    /* of all intervals together */
    MANY_PARTS = 64,        /* of which each is found a little less exactly, in half the time */
    FEWEST_OF_MANY = 60,
    LEAST_PIECES = 3,       /* of an interval, if there are very many intervals */
    MOST_ELEMENTS = 400000, /* more of them are not cut into narrower ones */
    MOST_CUTS = 4,          /* pieces of an element in one round */
    LEAVING_CUTS = 3,       /* of the element that leaves rest */
};

static const double gaps[] = {0.03, 0.003, 5e-4, 3e-4}; /* share of the duration the barrier costs */
/* Shares of the limits of velocity, acceleration and jerk: above them all of the path would be slowed
 * by more than half a thousandth, which is worth another round. */
static const double over[] = {1.0005, 1.001, 1.0015};
enum { GAPS = sizeof gaps / sizeof *gaps };
#define LAST_GAP gaps[GAPS - 1]
#define AGAIN 10.0          /* times the gap to begin with from a profile that is nearly right */

#define REST 1e-9           /* of the largest angular velocity of the part */
#define STILL 1e-9          /* m/s: the position at an end */
#define LEAVING 0.8         /* of a length L that the parameter goes while it leaves rest */
#define NARROW 0.25         /* of a period: elements that take less time are narrow enough */
#define RAMP 0.25           /* change of the acceleration in an element, as a share of its limit */
#define CHANGE 0.5          /* of the squared rate in an element */
#define MISSED 1.01         /* share of a limit between the places that were looked at */
#define GIVEN 1.0002        /* share of a limit that is used where an end is at it */
#define MAY_LIMIT 0.6       /* share of an axis' limit in a profile of the tool alone */

/* A part of the path: its knots, how it leaves rest, and which of its ends move. */
typedef struct {
    const timing_t *asked;
    row_t knots;
    double begin, end, last, leaves[2], total;
    bool moves[2];
    struct { double omega[3], alpha[3]; } ends[2];
    matrix_t axis_limits;  /* of the axes that may be in the way */
} part_t;

/* A profile on its mesh. */
typedef struct { matrix_t rows; index_t n; } mesh_t;

static double *row(const mesh_t *mesh, int which) { return mesh->rows.v + which * (mesh->n + 2); }

static bool new_mesh(mesh_t *mesh, index_t n) {
    mesh->n = n;
    mesh->rows = (matrix_t){calloc((size_t)(PROFILE_ROWS * (n + 2)), sizeof(double)),
                            PROFILE_ROWS, n + 2};
    return mesh->rows.v != NULL;
}

static void take_mesh(mesh_t *mesh, mesh_t other) {
    free(mesh->rows.v);
    *mesh = other;
}

static double length_of(const double *v) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/* A vector as a share of the limits of its norm and of its components. */
static double share_of(const double *v, const double *limits) {
    double most = fmax(fabs(v[1]) / limits[2], fabs(v[2]) / limits[3]);
    return fmax(length_of(v) / limits[0], fmax(fabs(v[0]) / limits[1], most));
}

static double least_of(const double *limits) {
    return fmin(fmin(limits[0], limits[1]), fmin(limits[2], limits[3]));
}

/* Read how a part begins and ends. */
static int read_part(const timing_t *asked, index_t place, part_t *part) {
    row_t knots = asked->knots;
    double begin = asked->edges.v[place], end = asked->edges.v[place + 1], fastest = 0.0;
    index_t first = 0;
    while (first + 2 < knots.n && knots.v[first + 1] <= begin)
        first++;
    index_t stop = first + 1;
    while (stop + 1 < knots.n && knots.v[stop] < end)
        stop++;
    index_t count = stop - first + 1, spots = 2 * count - 1;
    bool is_final = place + 2 == asked->edges.n;
    /* At a knot a trajectory is what begins there. */
    *part = (part_t){.asked = asked, .knots = {knots.v + first, count}, .begin = begin, .end = end,
                     .last = is_final ? end : nextafter(end, begin)};
    double *memory = malloc((size_t)(11 * spots) * sizeof *memory);
    if (memory == NULL)
        return OUT_OF_MEMORY;
    matrix_t samples = {memory + spots, 10, spots};
    for (index_t i = 0; i < spots; i++) {
        const double *at = part->knots.v + i / 2;
        memory[i] = i == spots - 1 ? part->last : i % 2 ? 0.5 * (at[0] + at[1]) : at[0];
    }
    sample_trajectory((row_t){memory, spots}, asked->breaks, asked->pieces, INFINITY, samples);
    for (index_t i = 0; i < spots; i++) {
        double w[3];
        for (int k = 0; k < 3; k++)
            w[k] = row_of(samples, 4 + k)[i];
        fastest = fmax(fastest, length_of(w));
    }
    part->total = end - begin;
    for (int side = 0; side < 2; side++) {
        index_t i = side ? spots - 1 : 0;
        double *omega = part->ends[side].omega, *alpha = part->ends[side].alpha, v[3] = {0.0};
        for (int k = 0; k < 3; k++)
            omega[k] = row_of(samples, 4 + k)[i], alpha[k] = row_of(samples, 7 + k)[i];
        if (asked->moves.n)
            put_move(asked->move_breaks, asked->moves, side ? nextafter(end, begin) : begin,
                     (move_t){NULL, v, NULL});
        double room = side ? end - part->knots.v[count - 2] : part->knots.v[1] - begin;
        room *= count == 2 ? 0.5 : 1.0;
        bool turns = length_of(omega) > REST * fastest;
        part->moves[side] = turns && !asked->is_at_rest;
        /* Where the path sets out with an acceleration, its angle grows like the square of its time,
         * and that of a motion from rest like the cube: like the square without a jerk limit. */
        if (asked->is_at_rest && (turns || length_of(v) > STILL))
            part->leaves[side] = -2.0 * room;
        else if (!turns && length_of(alpha) > REST * fastest
                 && least_of(row_of(asked->limits, 2)) < INFINITY)
            part->leaves[side] = room / LEAVING;
        part->total += leaving_gap(part->leaves[side]);
    }
    free(memory);
    return 0;
}

/* Write the derivatives of the axes' angles by the path coordinate at one spot.
 *
 * slope, bend: derivatives of the path time by the coordinate. */
static void put_axes(const timing_t *asked, double t, double slope, double bend, index_t spot,
                     index_t spots, profile_path_t *path) {
    index_t piece = piece_of(t, asked->axis_breaks), axes = asked->axis_limits.m;
    const double *c = row_of(asked->axis_pieces, piece);
    double u = t - asked->axis_breaks.v[piece];
    for (index_t k = 0; k < (axes + 2) / 3 * 3; k++) {
        double at[4] = {0};
        if (k < axes)
            quintic_at(c + k, axes, u, at);
        index_t to = 3 * (k / 3 * spots + spot) + k % 3;
        path->axis_first[to] = at[1] * slope;
        path->axis_second[to] = at[2] * slope * slope + at[1] * bend;
    }
}

/* Write the derivatives of orientation, position and axes by the path coordinate at all spots. */
static int put_derivatives(const part_t *part, const mesh_t *mesh, profile_path_t *path,
                           double **memory) {
    const timing_t *asked = part->asked;
    index_t n = mesh->n, spots = 2 * n + 1, moving = asked->moves.n ? spots : 0;
    index_t axes = part->axis_limits.m, angles = (axes + 2) / 3 * 3 * spots;
    double *next = malloc((size_t)(n + 21 * spots + 6 * moving + 2 * angles) * sizeof *next);
    *memory = next;
    if (next == NULL)
        return OUT_OF_MEMORY;
    *path = (profile_path_t){
        .widths = {next, n}, .first = {next + n, spots, 3},
        .second = {next + n + 3 * spots, spots, 3},
        .move_first = {next + n + 6 * spots, moving, 3},
        .move_second = {next + n + 6 * spots + 3 * moving, moving, 3},
        .limits = asked->limits, .move_limits = asked->move_limits,
        .aims = {row(mesh, AIMS), 3, n + 2},
        .has_start = part->moves[0], .has_end = part->moves[1],
        .axis_limits = part->axis_limits,
    };
    next += n + 6 * (spots + moving);
    path->axis_first = next, path->axis_second = next + angles;
    next += 2 * angles;
    row_t places = {next, spots}, instants = {next + spots, spots};
    matrix_t s = {next + 2 * spots, 3, spots}, samples = {next + 5 * spots, 10, spots};
    const double *x = row(mesh, PLACES);
    for (index_t e = 0; e < n; e++) {
        path->widths.v[e] = x[e + 1] - x[e];
        places.v[2 * e] = x[e], places.v[2 * e + 1] = 0.5 * (x[e] + x[e + 1]);
    }
    places.v[2 * n] = x[n];
    leave_rest(places, (row_t){(double *)part->leaves, 2}, part->total, s);
    for (index_t i = 0; i < spots; i++)
        instants.v[i] = fmin(fmax(part->begin + row_of(s, 0)[i], part->begin), part->last);
    sample_trajectory(instants, asked->breaks, asked->pieces, INFINITY, samples);
    for (index_t i = 0; i < spots; i++) {
        double slope = row_of(s, 1)[i], bend = row_of(s, 2)[i], v[3], a[3];
        for (int k = 0; k < 3; k++) {
            double omega = row_of(samples, 4 + k)[i], alpha = row_of(samples, 7 + k)[i];
            row_of(path->first, i)[k] = omega * slope;
            row_of(path->second, i)[k] = alpha * slope * slope + omega * bend;
        }
        if (axes)
            put_axes(asked, instants.v[i], slope, bend, i, spots, path);
        if (!moving)
            continue;
        put_move(asked->move_breaks, asked->moves, instants.v[i], (move_t){NULL, v, a});
        for (int k = 0; k < 3; k++) {
            row_of(path->move_first, i)[k] = v[k] * slope;
            row_of(path->move_second, i)[k] = a[k] * slope * slope + v[k] * bend;
        }
    }
    return 0;
}

/* Write value and slope at the nodes, and when they are passed; return the duration. */
static double put_nodes(const mesh_t *mesh) {
    index_t n = mesh->n;
    const double *x = row(mesh, PLACES), *c = row(mesh, COEFFICIENTS);
    for (index_t i = 0; i <= n; i++) {
        double before = i ? x[i] - x[i - 1] : 0.0, after = i < n ? x[i + 1] - x[i] : 0.0;
        row(mesh, VALUES)[i] = (after * c[i] + before * c[i + 1]) / (before + after);
        row(mesh, SLOPES)[i] = 2.0 * (c[i + 1] - c[i]) / (before + after);
    }
    put_node_times((row_t){row(mesh, PLACES), n + 1}, (row_t){row(mesh, VALUES), n + 1},
                   (row_t){row(mesh, SLOPES), n + 1}, (row_t){row(mesh, TIMES), n + 1});
    return row(mesh, TIMES)[n];
}

/* Aim lower where limits are exceeded. */
static void aim_lower(const mesh_t *mesh) {
    for (int order = 0; order < 3; order++) {
        double *aims = row(mesh, AIMS + order), *shares = row(mesh, SHARES + order);
        for (index_t e = 0; e < mesh->n; e++)
            /* But not where what is given at an end is at a limit. */
            if (!(aims[e] < 1.0 && shares[e] < GIVEN))
                aims[e] *= fmax(shares[e], 1.0);
    }
}

static bool is_one_of_many(const part_t *part) { return part->asked->edges.n > MANY_PARTS; }

static index_t pieces_of(index_t intervals, bool is_one_of_many) {
    index_t fewest = is_one_of_many ? FEWEST_OF_MANY : FEWEST_PIECES;
    if (intervals * PIECES_OF_INTERVAL > MOST_ELEMENTS)
        return most(LEAST_PIECES, MOST_ELEMENTS / intervals);
    return most(PIECES_OF_INTERVAL, (fewest + intervals - 1) / intervals);
}

/* Make a mesh of wide elements, which end where the formula of the path changes. */
static bool first_mesh(const part_t *part, mesh_t *mesh) {
    index_t intervals = part->knots.n - 1, e = 0;
    index_t pieces = pieces_of(intervals, is_one_of_many(part));
    if (!new_mesh(mesh, intervals * pieces))
        return false;
    double begin = 0.0, *x = row(mesh, PLACES);
    for (index_t i = 1; i <= intervals; i++) {
        double end = i == intervals ? part->total
                   : coordinate_of(part->knots.v[i] - part->begin, part->leaves, part->total);
        for (index_t k = 0; k < pieces; k++)
            x[e++] = begin + (end - begin) / (double)pieces * (double)k;
        begin = end;
    }
    x[e] = begin;
    for (index_t i = 0; i < 3; i++)
        for (e = 0; e < mesh->n; e++)
            row(mesh, AIMS + (int)i)[e] = 1.0;
    /* The timing cannot change the rates given at an end, so the limits there just admit them. */
    for (int side = 0; side < 2; side++)
        for (int order = 0; order < 2 && part->moves[side]; order++) {
            const double *given = order ? part->ends[side].alpha : part->ends[side].omega;
            double share = share_of(given, row_of(part->asked->limits, order));
            double highest = order ? 0.9993 : 0.9999;
            for (index_t k = 0; k < pieces && share > highest; k++) {
                double fading = 1.0 - fmax((double)k - 1.0, 0.0) / (double)pieces;
                double *aim = row(mesh, AIMS + order) + (side ? mesh->n - 1 - k : k);
                *aim = fmin(*aim, 1.0 - fading * (1.0 - highest / share));
            }
        }
    return true;
}

/* Cut elements into pieces, and write the same profile on them. */
static bool cut(const mesh_t *mesh, const index_t *pieces, mesh_t *finer) {
    index_t count = 0, to = 0;
    for (index_t e = 0; e < mesh->n; e++)
        count += pieces[e];
    if (!new_mesh(finer, count))
        return false;
    const double *x = row(mesh, PLACES), *y = row(mesh, VALUES), *d = row(mesh, SLOPES);
    for (index_t e = 0; e < mesh->n; e++) {
        double h = x[e + 1] - x[e], width = h / (double)pieces[e], bend = (d[e + 1] - d[e]) / h;
        for (index_t k = 0; k < pieces[e]; k++, to++) {
            double ahead = width * (double)k, slope = d[e] + ahead * bend;
            double value = y[e] + ahead * (d[e] + 0.5 * ahead * bend);
            row(finer, PLACES)[to] = x[e] + ahead;
            /* A coefficient is the polar form of the quadratic at both ends of its element. */
            row(finer, COEFFICIENTS)[to + 1] = value + 0.5 * width * slope;
            for (int order = 0; order < 3; order++)
                row(finer, AIMS + order)[to] = row(mesh, AIMS + order)[e];
        }
    }
    row(finer, PLACES)[to] = x[mesh->n];
    row(finer, COEFFICIENTS)[0] = y[0], row(finer, COEFFICIENTS)[to + 1] = y[mesh->n];
    return true;
}

/* Whether a profile goes down to zero in an element, between the places that were checked. */
static bool dips(const mesh_t *mesh, index_t e) {
    const double *x = row(mesh, PLACES), *y = row(mesh, VALUES);
    double inner = y[e] + 0.5 * (x[e + 1] - x[e]) * row(mesh, SLOPES)[e];
    return inner <= 0.0 && inner * inner >= y[e] * y[e + 1];
}

static bool has_dips(const mesh_t *mesh) {
    for (index_t e = 0; e < mesh->n; e++)
        if (dips(mesh, e))
            return true;
    return false;
}

/* Lift a profile out of its dips, without regard to the limits. */
static void lift_dips(const mesh_t *mesh) {
    /* The tangents at the ends of an element meet at its coefficient. */
    for (index_t e = 0; e < mesh->n; e++)
        if (dips(mesh, e))
            row(mesh, COEFFICIENTS)[e + 1] = 0.0;
    put_nodes(mesh);
}

/* Count into how many pieces to cut each element; return whether any element is cut.
 *
 * is_fine: only those that exceed a limit, and their neighbours. */
static bool put_cuts(const part_t *part, const mesh_t *mesh, const profile_path_t *path, bool is_fine,
                     double *wanted, index_t *pieces) {
    index_t n = mesh->n;
    const double *y = row(mesh, VALUES), *d = row(mesh, SLOPES);
    bool is_cut = false;
    for (index_t e = 0; e < n; e++) {
        /* How much of the limits of acceleration a change of the rate takes. */
        double pull = share_of(row_of(path->first, 2 * e + 1), row_of(part->asked->limits, 1));
        for (index_t k = 0; k < path->axis_limits.m; k++) {
            double slope = path->axis_first[3 * (k / 3 * (2 * n + 1) + 2 * e + 1) + k % 3];
            pull = fmax(pull, fabs(slope) / row_of(path->axis_limits, 1)[k]);
        }
        wanted[e] = fmax(0.5 * fabs(d[e + 1] - d[e]) * pull / RAMP,
                         fabs(y[e + 1] - y[e]) / fmax(y[e], y[e + 1]) / CHANGE);
        if (is_fine)
            wanted[e] = 0.0;
        for (int order = 0; order < 3; order++) {
            double most = is_fine ? over[order] : MISSED;
            wanted[e] = fmax(wanted[e], row(mesh, SHARES + order)[e] / most);
        }
        if (dips(mesh, e))
            wanted[e] = fmax(wanted[e], MOST_CUTS);
    }
    /* Near rest the jerk changes between the places that were checked. */
    for (int side = 0; side < 2; side++)
        if (part->leaves[side] > 0.0)
            wanted[side ? n - 1 : 0] = fmax(wanted[side ? n - 1 : 0], LEAVING_CUTS);
    for (index_t e = 0; e < n; e++) {
        /* The neighbour of a quick change may become one. */
        double around = fmax(wanted[e], fmax(e ? wanted[e - 1] : 0.0,
                                             e + 1 < n ? wanted[e + 1] : 0.0));
        double time = 2.0 * path->widths.v[e] / (sqrt(y[e]) + sqrt(y[e + 1]));
        double count = ceil(fmin(around, time / (NARROW * part->asked->period)));
        pieces[e] = (index_t)fmin(fmax(count, 1.0), MOST_CUTS);
        is_cut |= pieces[e] > 1;
    }
    return is_cut;
}

/* Write coefficients to begin with, about as quick as the path where that moves. */
static void put_guess(const part_t *part, const mesh_t *mesh, const profile_path_t *path) {
    index_t n = mesh->n;
    double sizes[3] = {0.0}, level = INFINITY, *c = row(mesh, COEFFICIENTS);
    for (index_t i = 0; i <= 2 * n; i++) {
        const double *second = row_of(path->second, i);
        sizes[0] = fmax(sizes[0], length_of(row_of(path->first, i)));
        sizes[1] = fmax(sizes[1], length_of(second));
        if (i < 2 * n) {
            double change[3], width = 0.5 * path->widths.v[i / 2];
            for (int k = 0; k < 3; k++)
                change[k] = (second[k + 3] - second[k]) / width;
            sizes[2] = fmax(sizes[2], length_of(change));
        }
    }
    for (int order = 0; order < 3; order++) {
        double share = least_of(row_of(part->asked->limits, order)) / sizes[order];
        if (sizes[order] > 0.0 && share < INFINITY)
            level = fmin(level, order == 0 ? share * share : order == 1 ? share
                                                                        : cbrt(share * share));
    }
    level = level < INFINITY ? 0.5 * level : 1.0;
    bool has_moves = part->moves[0] || part->moves[1];
    bool leaves = part->leaves[0] != 0.0 || part->leaves[1] != 0.0;
    for (index_t e = 0; e < n; e++) {
        double x = 0.5 * (row(mesh, PLACES)[e] + row(mesh, PLACES)[e + 1]), s[3];
        leave_rest((row_t){&x, 1}, (row_t){(double *)part->leaves, 2}, part->total,
                   (matrix_t){s, 3, 1});
        c[e + 1] = has_moves ? 1.0 / (s[1] * s[1] + (leaves ? 1.0 / level : 0.0)) : level;
    }
    c[0] = c[1], c[n + 1] = c[n];
    if (part->moves[0])
        c[0] = c[1] = 1.0;
    if (part->moves[1])
        c[n] = c[n + 1] = 1.0;
}

/* Find the best profile on a mesh, from its coefficients on; without them from a guess. */
static int solve(const part_t *part, mesh_t *mesh, bool is_known, double begin, double gap) {
    profile_path_t path;
    double *memory;
    int found = put_derivatives(part, mesh, &path, &memory);
    if (!found) {
        if (!is_known)
            put_guess(part, mesh, &path);
        found = find_profile(&path, begin, gap, (row_t){row(mesh, COEFFICIENTS), mesh->n + 2},
                             (matrix_t){row(mesh, SHARES), 3, mesh->n + 2});
    }
    free(memory);
    put_nodes(mesh);
    return found;
}

/* Narrow a mesh where its profile changes quickly; return whether it is another one.
 *
 * is_fine: only where the profile exceeds a limit. */
static int refine(const part_t *part, mesh_t *mesh, mesh_t *finer, bool is_fine) {
    profile_path_t path;
    double *memory;
    int is_finer = put_derivatives(part, mesh, &path, &memory);
    index_t n = mesh->n, *pieces = malloc((size_t)n * sizeof *pieces);
    double *wanted = malloc((size_t)n * sizeof *wanted);
    if (is_finer || pieces == NULL || wanted == NULL)
        is_finer = OUT_OF_MEMORY;
    else {
        is_finer = n < MOST_ELEMENTS && put_cuts(part, mesh, &path, is_fine, wanted, pieces);
        aim_lower(mesh);
        lift_dips(mesh);
        if (!is_finer)
            for (index_t e = 0; e < n; e++)
                pieces[e] = 1;
        if (!cut(mesh, pieces, finer))
            is_finer = OUT_OF_MEMORY;
        else if (!is_finer)
            memcpy(row(finer, COEFFICIENTS), row(mesh, COEFFICIENTS), (size_t)(n + 2) * sizeof(double));
    }
    free(wanted), free(pieces), free(memory);
    return is_finer;
}

/* Whether the profile that was found exceeds a limit by so much that it slows all of the path down. */
static bool exceeds(const mesh_t *mesh) {
    for (int order = 0; order < 3; order++)
        for (index_t e = 0; e < mesh->n; e++)
            if (row(mesh, SHARES + order)[e] > over[order])
                return true;
    return false;
}

/* Leave the axes that a profile of the tool alone brings near to their limits; return how that went. */
static int choose_axes(part_t *part, const mesh_t *mesh) {
    profile_path_t path;
    double *memory;
    int failed = put_derivatives(part, mesh, &path, &memory);
    if (!failed && free_axes(&path, row(mesh, VALUES), row(mesh, SLOPES), MAY_LIMIT))
        part->axis_limits.m = 0;
    free(memory);
    return failed;
}

/* Find a first profile: of the tool, then with the axes that limit it, and then with their jerk, which
 * is far from convex. */
static int solve_with_axes(part_t *part, mesh_t *mesh) {
    matrix_t limits = part->axis_limits;
    /* The pace of the path itself suits an end that moves: the search begins with it. */
    if (part->moves[0] || part->moves[1])
        return solve(part, mesh, false, 1.0, gaps[0]);
    part->axis_limits.m = 0;
    int found = solve(part, mesh, false, 1.0, gaps[0]);
    if (!limits.m || found != PROFILE_FOUND)
        return found;
    part->axis_limits = limits;
    found = choose_axes(part, mesh);
    if (found == OUT_OF_MEMORY || !part->axis_limits.m)
        return found == OUT_OF_MEMORY ? found : PROFILE_FOUND;
    part->axis_limits.n = 2;
    found = solve(part, mesh, true, 1.0, gaps[0]);
    part->axis_limits.n = 3;
    double least = INFINITY;
    for (index_t k = 0; k < limits.m; k++)
        least = fmin(least, row_of(limits, 2)[k]);
    return found == PROFILE_FOUND && least < INFINITY ? solve(part, mesh, true, 1.0, gaps[0]) : found;
}

/* Find the quickest profile on ever narrower meshes. */
static int search(part_t *part, mesh_t *mesh) {
    index_t count = 0, budget = BUDGET + BUDGET_OF_INTERVAL * (part->knots.n - 1);
    int found = solve_with_axes(part, mesh);
    put_nodes(mesh);
    for (int round = 0; found == PROFILE_FOUND; round++) {
        double gap = gaps[round < GAPS ? round : GAPS - 1], next = gaps[round + 1 < GAPS ? round + 1 : GAPS - 1];
        mesh_t finer = {{NULL, 0, 0}, 0};
        bool is_over = exceeds(mesh) || has_dips(mesh);
        count += mesh->n;
        if (round + 1 == MOST_ROUNDS || (round + 1 >= FEWEST_ROUNDS && count >= budget && !is_over))
            break;
        /* A position has no limit of the jerk: it may change quickly between the places that were checked. */
        bool is_fine = count >= budget && !part->asked->moves.n;
        int is_finer = refine(part, mesh, &finer, is_fine);
        if (is_finer == OUT_OF_MEMORY) {
            free(finer.rows.v);
            return OUT_OF_MEMORY;
        }
        int better = PROFILE_NOT_FOUND;
        if (is_finer || is_over || gap > LAST_GAP)
            better = solve(part, &finer, true, AGAIN * next, next);
        if (better != PROFILE_FOUND) {
            free(finer.rows.v);
            return better == OUT_OF_MEMORY ? OUT_OF_MEMORY : PROFILE_FOUND;
        }
        take_mesh(mesh, finer);
    }
    return found;
}

static int time_part(part_t *part, mesh_t *mesh) {
    /* A part has limits of its own: those of axes that are never near them are taken away. */
    double limits[3 * MOST_AXES];
    part->axis_limits = (matrix_t){limits, 3, part->asked->axis_limits.m};
    memcpy(limits, part->asked->axis_limits.v, (size_t)(3 * part->axis_limits.m) * sizeof *limits);
    if (!first_mesh(part, mesh))
        return OUT_OF_MEMORY;
    int found = search(part, mesh);
    if (found != PROFILE_FOUND)
        return found == OUT_OF_MEMORY ? OUT_OF_MEMORY : NO_WAY;
    /* Dips that are left are in elements too narrow to be cut; the records hardly show them. */
    lift_dips(mesh);
    return has_dips(mesh) ? STANDS_STILL : TIMED;
}

int time_quickest(const timing_t *asked, timed_t *timed) {
    index_t parts = asked->edges.n - 1, size = 0, to = 0;
    mesh_t *meshes = calloc((size_t)parts, sizeof *meshes);
    timed->rows.v = NULL;
    timed->parts = malloc((size_t)(PART_NUMBERS * parts) * sizeof(double));
    int found = meshes == NULL || timed->parts == NULL ? OUT_OF_MEMORY : TIMED;
    for (index_t i = 0; i < parts && found == TIMED; i++) {
        part_t part;
        found = read_part(asked, i, &part) ? OUT_OF_MEMORY : time_part(&part, &meshes[i]);
        double *to_part = timed->parts + PART_NUMBERS * i;
        to_part[0] = (double)meshes[i].n;
        to_part[1] = part.leaves[0], to_part[2] = part.leaves[1];
        to_part[3] = part.moves[0], to_part[4] = part.moves[1];
        to_part[5] = part.begin, to_part[6] = part.end;
        size += meshes[i].n + 2;
    }
    if (found == TIMED) {
        timed->rows = (matrix_t){malloc((size_t)(PROFILE_ROWS * size) * sizeof(double)),
                                 PROFILE_ROWS, size};
        found = timed->rows.v == NULL ? OUT_OF_MEMORY : TIMED;
    }
    for (index_t i = 0; i < parts && found == TIMED; to += meshes[i++].n + 2)
        for (int k = 0; k < PROFILE_ROWS; k++)
            memcpy(row_of(timed->rows, k) + to, row(&meshes[i], k),
                   (size_t)(meshes[i].n + 2) * sizeof(double));
    for (index_t i = 0; i < parts && meshes != NULL; i++)
        free(meshes[i].rows.v);
    free(meshes);
    if (found != TIMED) {
        free(timed->rows.v), free(timed->parts);
        timed->rows.v = timed->parts = NULL;
    }
    return found;
}
