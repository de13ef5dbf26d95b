/* From a connector that was found to the spline that is shortened, and from that to joins. */
#include "shorten.h"

/* Of the limit of the velocity, which the spline keeps everywhere. */
#define VELOCITY_SHARE 0.9998
/* Share of the limit of the velocity that is near it. */
#define NEARLY 0.99
/* Of the time in which the acceleration rises to its limit, the narrowest element. */
#define NARROWEST 0.06
/* For each rad/s, the same, s: it must not be so narrow that rounding of the velocity shows in the
 * acceleration, by more than 1e-12 rad/s^2. */
#define FINEST 8e-4
/* Fewest periods of a connector that is shortened: of a shorter one little is left to gain. */
#define FEWEST 6.0

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
    rate->first = first, rate->count = count, rate->order = order, rate->ease = 1.0;
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

/* How long an acceleration takes to fall that would else become too fast, s. */
static double falls_in(const bounds_t *bounds, vec_t omega, vec_t alpha) {
    double longest = 0.0;
    for (int k = 0; k < 4; k++) {
        double falls = size_of(alpha, k) / bounds->most[2][k];
        if (size_of(scaled_plus(0.5 * falls, alpha, omega), k) > NEARLY * bounds->most[0][k])
            longest = fmax(longest, falls);
    }
    return longest;
}

/* Let go of the jerk's reserve while an acceleration falls that would else become too fast: what a
 * device moves with was planned with less of a reserve. */
static void ease_end(spline_t *s, vec_t omega, vec_t alpha, double ease, bool is_end) {
    double falls = falls_in(&s->bounds, omega, alpha), before = 0.0;
    for (int i = 0; i < s->rates; i++) {
        rate_t *rate = &s->rate[is_end ? s->rates - 1 - i : i];
        if (rate->order != 2)
            continue;
        if (before < falls)
            rate->ease = ease;
        before += s->width[rate->first] * s->duration;
    }
}

/* Velocity of joins at a time, and the orientation that they arrive at. */
static vec_t velocity_of(const join_t joins[3], row_t times_of, double time) {
    int k = time >= times_of.v[2] && times_of.v[3] > times_of.v[2] ? 2
          : time >= times_of.v[1] || !(times_of.v[1] > 0.0) ? 1 : 0;
    double u = (time - times_of.v[k]) * joins[k].per_second;
    return join_at(quat(1.0, 0.0, 0.0, 0.0), &joins[k], join_basis(fmin(fmax(u, 0.0), 1.0))).omega;
}

/* Begin with the connector that was found. */
static void put_first(spline_t *s, matrix_t q, tensor_t w, row_t times_of) {
    join_t joins[3];
    quat_t last = quat_at(row_of(q, 0));
    for (int i = 0; i < 3; i++) {
        vec_t of[FACTORS];
        double takes = times_of.v[i + 1] - times_of.v[i];
        for (int k = 0; k < FACTORS; k++)
            of[k] = vec_at(w.v + (i * FACTORS + k) * 3);
        joins[i] = join_of(of, takes > 0.0 ? takes : 1.0);
        if (!(takes > 0.0))
            continue;
        last = quat_at(row_of(q, i));
        for (int k = 0; k < FACTORS; k++)
            last = multiplied(last, exponential(of[k]));
    }
    if (last.w * s->end.q.w + last.x * s->end.q.x + last.y * s->end.q.y + last.z * s->end.q.z < 0.0)
        s->end.q = opposite(s->end.q);
    double before = 0.0;
    for (int k = 0; k + 2 < s->elements; k++) {
        /* A control point is the velocity half way between two nodes, nearly. */
        double here = before + s->width[k];
        s->point[k + 2] = velocity_of(joins, times_of, (here + 0.5 * s->width[k + 1]) * s->duration);
        before = here;
    }
}

/* The integral of the angular velocity. */
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

static index_t put_shorter(const spline_t *s, matrix_t joins, tensor_t increments, row_t breaks) {
    int n = s->elements;
    motion_t from = s->begin;
    double begun = 0.0;
    for (int k = 0; k < n; k++) {
        motion_t to = {s->node[k + 1], velocity_at(s, k + 1), acceleration_at(s, k + 1)};
        double share = k + 1 < n ? begun / s->duration + s->width[k] : 1.0;
        double ended = share * s->duration;
        if (k + 1 == n)
            to = s->end;
        vec_t of[FACTORS];
        put_increments(&from, &to, ended - begun, of);
        breaks.v[k] = begun;
        put_quat(row_of(joins, k), from.q);
        for (int i = 0; i < FACTORS; i++)
            put_vec(increments.v + (k * FACTORS + i) * 3, of[i]);
        from = to, begun = ended;
    }
    breaks.v[n] = begun;
    return n;
}

index_t shorten_connector(row_t start, row_t end, matrix_t limits, double period, double least,
                          double most_turn, double longest, double ease, matrix_t q, tensor_t w, row_t times_of,
                          matrix_t joins, tensor_t increments, row_t breaks) {
    spline_t s;
    double total = times_of.v[3];
    if (!(total >= FEWEST * period && total > least))
        return 0;
    s.begin = state_at(start.v), s.end = state_at(end.v);
    s.bounds = bounds_of(&s.begin, &s.end, limits);
    for (int k = 0; k < 4; k++)
        s.bounds.most[0][k] = fmax(s.bounds.most[0][k], VELOCITY_SHARE * row_of(limits, 0)[k]);
    s.duration = total, s.least = fmax(least, period), s.most = longest + period;
    put_elements(&s, period);
    put_rates(&s);
    ease_end(&s, s.begin.omega, s.begin.alpha, ease, false);
    ease_end(&s, s.end.omega, times(-1.0, s.end.alpha), ease, true);
    put_first(&s, q, w, times_of);
    if (!shorten(&s, period) || !(s.duration < longest + 0.5 * period)
        || !(norm(turn_of(&s)) <= most_turn))
        return 0;
    return put_shorter(&s, joins, increments, breaks);
}
