/* From the way by rest to the spline that is shortened, and from that to phases. */
#include "shorten.h"

/* Times the way by rest, that a spline may take on its way to a shorter one. */
#define LONGER 8.0
/* Of the time in which the acceleration rises to its limit, the narrowest element. */
#define NARROWEST 0.06
/* For each rad/s, the same, s: it must not be so narrow that rounding of the velocity shows in the
 * acceleration, by more than 1e-12 rad/s^2. */
#define FINEST 8e-4
/* Fewest periods of a connector that is shortened: of a shorter one little is left to gain. */
#define FEWEST 6.0
/* Of the limit of the velocity, for peaks between the control points. */
#define VELOCITY_MARGIN 0.9999
/* The bounds are those of the ends: rounding must not decide whether these keep them. */
#define ROUNDING 1e-9
#define WHOLE 1e-9          /* of a period */

/* Return the limits, but never less than what a device has in either of two states. */
static bounds_t bounds_of(const motion_t *start, const motion_t *end, matrix_t limits) {
    bounds_t bounds;
    for (int order = 0; order < 3; order++)
        for (int k = 0; k < 4; k++)
            bounds.most[order][k] = row_of(limits, order)[k] * (order ? 1.0 : VELOCITY_MARGIN);
    vec_t has[2][2] = {{start->omega, end->omega}, {start->alpha, end->alpha}};
    for (int order = 0; order < 2; order++)
        for (int i = 0; i < 2; i++)
            for (int k = 0; k < 4; k++)
                bounds.most[order][k] = fmax(bounds.most[order][k], size_of(has[order][i], k));
    for (int order = 0; order < 3; order++)
        for (int k = 0; k < 4; k++)
            bounds.most[order][k] *= 1.0 + ROUNDING;
    return bounds;
}

void put_given(spline_t *s) {
    int n = s->elements;
    double T = s->duration;
    s->point[0] = s->begin.omega;
    s->point[1] = scaled_plus(0.5 * T * s->width[0], s->begin.alpha, s->begin.omega);
    s->point[n] = scaled_plus(-0.5 * T * s->width[n - 1], s->end.alpha, s->end.omega);
    s->point[n + 1] = s->end.omega;
}

vec_t velocity_at(const spline_t *s, int node) {
    double before = node ? s->width[node - 1] : 0.0;
    double share = before / s->sum[node];
    return plus(times(1.0 - share, s->point[node]), times(share, s->point[node + 1]));
}

vec_t acceleration_at(const spline_t *s, int node) {
    if (node == 0)
        return s->begin.alpha;
    if (node == s->elements)
        return s->end.alpha;
    return times(2.0 / (s->sum[node] * s->duration), minus(s->point[node + 1], s->point[node]));
}

/* Cut into elements, by the times in which the acceleration can change. */
static void put_elements(spline_t *s, double period) {
    double rise = s->bounds.most[1][0] / s->bounds.most[2][0];
    double narrowest = fmax(rise < INFINITY ? NARROWEST * rise : 0.0, period);
    narrowest = fmax(narrowest, FINEST * fmax(norm(s->begin.omega), norm(s->end.omega)));
    int inner = (int)fmin(fmax(s->duration / period, 4.0), INNER), halvings = 0;
    double width = s->duration / (inner + 2);
    while (halvings < HALVINGS && width * exp2(-halvings) > narrowest)
        halvings++;
    int n = 0;
    double total = 0.0;
    for (int k = -halvings; k < inner + halvings; k++) {
        int from_end = k < 0 ? -k : k >= inner ? k - inner + 1 : 0;
        double share = exp2(-from_end);
        /* The outermost twice. */
        for (int twice = 0; twice < (from_end && from_end == halvings ? 2 : 1); twice++)
            total += s->width[n++] = share;
    }
    s->elements = n;
    for (int k = 0; k < n; k++)
        s->width[k] /= total;
    for (int k = 0; k <= n; k++)
        s->sum[k] = (k ? s->width[k - 1] : 0.0) + (k < n ? s->width[k] : 0.0);
}

/* Add a rate unless it has no limit. */
static void add_rate(spline_t *s, int order, int first, int count, const double *shares) {
    bool is_limited = false;
    for (int k = 0; k < 4; k++)
        is_limited |= s->bounds.most[order][k] < INFINITY;
    if (!is_limited)
        return;
    rate_t *rate = &s->rate[s->rates++];
    rate->first = first, rate->count = count, rate->order = order;
    for (int i = 0; i < count; i++)
        rate->share[i] = shares[i];
    vec_t given = vec(0.0, 0.0, 0.0);
    for (int i = 0; i < count; i++) {
        int point = first + i;
        if (point == 1)
            given = scaled_plus(0.5 * s->width[0] * shares[i], s->begin.alpha, given);
        if (point == s->elements)
            given = scaled_plus(-0.5 * s->width[s->elements - 1] * shares[i], s->end.alpha, given);
    }
    put_vec(rate->by_duration, given);
}

/* What is limited: control points, and what the velocity is between, never go beyond them.
 *
 * Those of the velocity are of parts of the elements: where it bends, those of whole ones are
 * PARTS^2 times as far beyond it, which a device that gains speed just below its limit cannot
 * afford. */
static void put_rates(spline_t *s) {
    int n = s->elements;
    s->rates = 0;
    for (int k = 1; k < n - 1; k++) {
        double before = s->width[k] / s->sum[k], after = s->width[k] / s->sum[k + 1];
        for (int part = 0; part < PARTS; part++) {
            double u = (double)part / PARTS, v = u + 1.0 / PARTS;
            double first = before * (1.0 - u) * (1.0 - v), last = after * u * v;
            add_rate(s, 0, k, 3, (double[]){first, 1.0 - first - last, last});
        }
    }
    for (int k = 1; k < n; k++)
        add_rate(s, 1, k, 2, (double[]){-2.0 / s->sum[k], 2.0 / s->sum[k]});
    for (int k = 0; k < n; k++) {
        double before = 2.0 / (s->sum[k] * s->width[k]);
        double after = 2.0 / (s->sum[k + 1] * s->width[k]);
        add_rate(s, 2, k, 3, (double[]){before, -before - after, after});
    }
}

/* Velocity at a time of phases of constant jerk. */
static vec_t velocity_of(const phases_t *phases, double time) {
    index_t k = 0;
    while (k + 2 < phases->count && phases->time[k + 1] <= time)
        k++;
    const motion_t *from = &phases->node[k], *to = from + 1;
    double h = phases->time[k + 1] - phases->time[k], t = fmin(fmax(time - phases->time[k], 0.0), h);
    vec_t change = scaled_plus(0.5 * t * t / h, minus(to->alpha, from->alpha), from->omega);
    return scaled_plus(t, from->alpha, change);
}

/* Begin with the way by rest. */
static void put_first(spline_t *s, const phases_t *rests) {
    double before = 0.0;
    for (int k = 0; k + 2 < s->elements; k++) {
        /* A control point is the velocity half way between two nodes, nearly. */
        double here = before + s->width[k];
        s->point[k + 2] = velocity_of(rests, (here + 0.5 * s->width[k + 1]) * s->duration);
        before = here;
    }
}

/* The integral of the angular velocity of phases of constant jerk. */
static vec_t turn_of_phases(const phases_t *phases) {
    vec_t turn = vec(0.0, 0.0, 0.0);
    for (index_t k = 0; k + 1 < phases->count; k++) {
        const motion_t *from = &phases->node[k], *to = from + 1;
        double h = phases->time[k + 1] - phases->time[k];
        turn = scaled_plus(0.5 * h, plus(from->omega, to->omega), turn);
        turn = scaled_plus(h * h / 12.0, minus(from->alpha, to->alpha), turn);
    }
    return turn;
}

/* The same of a spline. */
static vec_t turn_of(const spline_t *s) {
    int n = s->elements;
    vec_t turn = vec(0.0, 0.0, 0.0);
    for (int k = 0; k < n + 2; k++) {
        double width = (k > 1 ? s->width[k - 2] : 0.0) + (k > 0 && k <= n ? s->width[k - 1] : 0.0)
                     + (k < n ? s->width[k] : 0.0);
        turn = scaled_plus(width * s->duration / 3.0, s->point[k], turn);
    }
    return turn;
}

static bool put_shorter(const spline_t *s, phases_t *to) {
    int n = s->elements;
    double begun = 0.0;
    to->count = 1;
    for (int k = 0; k < n; k++) {
        bool is_last = k + 1 == n;
        double share = is_last ? 1.0 : begun / s->duration + s->width[k];
        double ended = share * s->duration;
        vec_t omega = is_last ? s->end.omega : velocity_at(s, k + 1);
        if (!add_parts(to, omega, acceleration_at(s, k + 1), ended - begun, LONGEST_BENT))
            return false;
        to->node[to->count - 1].q = is_last ? s->end.q : s->node[k + 1];
        to->time[to->count - 1] = begun = ended;
    }
    return true;
}

bool shorten_connector(phases_t *rests, matrix_t limits, double period, double least,
                       double most_turn, double more) {
    spline_t s;
    double total = rests->time[rests->count - 1];
    if (most_turn >= 0.0)
        most_turn = fmax(most_turn, norm(turn_of_phases(rests)));
    if (!(total >= FEWEST * period && total > least + 0.5 * period))
        return true;
    spline_t best;
    best.duration = total, best.elements = 0;
    outcome_t outcome = LOST;
    /* A motion that already uses all of acceleration and jerk leaves no room to look for a shorter
     * way.  So where the first try got stuck, another one has more of them. */
    for (int k = 0; k < (more > 1.0 ? 2 : 1) && outcome != CONVERGED; k++) {
        s.begin = rests->node[0], s.end = rests->node[rests->count - 1];
        s.bounds = bounds_of(&s.begin, &s.end, limits);
        for (int i = 0; k && i < 4; i++)
            s.bounds.most[1][i] *= more, s.bounds.most[2][i] *= more;
        s.duration = total, s.most = LONGER * total;
        s.least = (fmax(ceil(least / period - WHOLE), 1.0) - 0.5) * period;
        put_elements(&s, period);
        put_rates(&s);
        put_first(&s, rests);
        outcome = shorten(&s, period);
        if (outcome != LOST && s.duration < best.duration - 0.5 * period
            && norm(turn_of(&s)) <= most_turn)
            best = s;
    }
    return !best.elements || put_shorter(&best, rests);
}
