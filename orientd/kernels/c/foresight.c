/* Foresee a stop; see foresight.h. */
#include "foresight.h"

#include "rotation.h"

#define SPEED_SHARE 0.98
/* The check looks at a few instants of a stop; between them an axis may be faster. */
#define STOP_SPEED_SHARE 0.9
#define STOP_ACCELERATION_SHARE 0.5
/* The first cycle of a stop is checked exactly. */
#define FIRST_ACCELERATION_SHARE 0.7
/* A device lags behind its setpoints, and stops at the very end of an axis' range. */
#define RANGE_MARGIN 0.02
#define STILL 1e-9

/* The orientation since the beginning of the turn, s. */
static quat_t turned_since(const coming_stop_t *stop, double since) {
    const double jerks[3] = {-stop->jerk, 0.0, stop->jerk};
    double angle = 0.0, speed = stop->speed, rate = stop->rate;
    for (int k = 0; k < 3; k++) {
        double t = smaller(since, stop->phases[k]);
        angle += t * (speed + t * (0.5 * rate + t * jerks[k] / 6.0));
        speed += t * (rate + 0.5 * t * jerks[k]);
        rate += t * jerks[k];
        since -= t;
    }
    return multiplied(quat_at(stop->braked), exponential(times(0.5 * angle, vec_at(stop->axis))));
}

static void put(row_t seconds, matrix_t poses, index_t i, double time, quat_t q, vec_t position) {
    seconds.v[i] = time;
    put_quat(row_of(poses, i), q);
    put_vec(row_of(poses, i) + 4, position);
}

index_t foresee_stop(const coming_stop_t *stop, row_t seconds, matrix_t poses) {
    double h = stop->period, acceleration = stop->acceleration;
    vec_t position = vec_at(stop->position), velocity = vec_at(stop->velocity);
    put(seconds, poses, 0, h, quat_at(stop->q), position);
    double turning = stop->phases[0] + stop->phases[1] + stop->phases[2], speed = norm(velocity);
    if (turning == 0.0 && speed == 0.0)
        return 1;
    double change = acceleration * h;
    velocity = times(speed > change ? 1.0 - change / speed : 0.0, velocity);
    speed = larger(speed - change, 0.0);
    position = scaled_plus(h, velocity, position);
    put(seconds, poses, 1, h, quat_at(stop->braked), position);
    /* The velocity of a step is that of its middle, and the next one is already slower. */
    double running = larger(speed / acceleration - 0.5 * h, 0.0);
    double share = speed > 0.0 ? running * acceleration / speed : 0.0;
    double longest = larger(larger(running, turning), h), cycles = ceil(longest / h);
    index_t later = seconds.n - 2, count = cycles < (double)later ? (index_t)cycles : later;
    for (index_t k = 1; k <= count; k++) {
        double since = longest * (double)k / (double)count;
        double left = since < running ? 1.0 - since / running : 0.0;
        double along = 0.5 * running * share * (1.0 - left * left);
        quat_t q = turning > 0.0 ? turned_since(stop, since) : quat_at(stop->braked);
        put(seconds, poses, 1 + k, longest / (double)count, q,
            scaled_plus(along, velocity, position));
    }
    return 2 + count;
}

static index_t strained(row_t strain, index_t row, index_t axis, int kind, double value,
                        double limit) {
    strain.v[0] = (double)axis, strain.v[1] = kind, strain.v[2] = value, strain.v[3] = limit;
    return row;
}

index_t first_strain(row_t seconds, matrix_t joints, matrix_t last, matrix_t axes, double period,
                     row_t strain) {
    for (index_t i = 0; i < joints.n; i++) {
        double before = i ? seconds.v[i - 1] : period, since = 0.5 * (seconds.v[i] + before);
        double speed_share = i ? STOP_SPEED_SHARE : SPEED_SHARE;
        double share = i > 1 ? STOP_ACCELERATION_SHARE : i ? FIRST_ACCELERATION_SHARE : 1.0;
        const double *now = row_of(joints, i), *near = i ? row_of(joints, i - 1) : row_of(last, 0);
        const double *earlier = i > 1 ? row_of(joints, i - 2) : row_of(last, 0);
        for (index_t k = 0; k < joints.m; k++) {
            const double *axis = row_of(axes, k);
            double rate = (now[k] - near[k]) / seconds.v[i];
            double old = i ? (near[k] - earlier[k]) / before : row_of(last, 1)[k];
            double change = fabs(rate - old) / since;
            if (fabs(rate) > speed_share * axis[2] && fabs(rate) > fabs(old))
                return strained(strain, i, k, TOO_FAST, fabs(rate), speed_share * axis[2]);
            if (change > share * axis[3])
                return strained(strain, i, k, TOO_SUDDEN, change, share * axis[3]);
            if ((now[k] > axis[1] - RANGE_MARGIN && rate > STILL)
                || (now[k] < axis[0] + RANGE_MARGIN && rate < -STILL))
                return strained(strain, i, k, AT_ITS_END, now[k], rate > 0.0 ? axis[1] : axis[0]);
        }
    }
    return joints.n;
}
