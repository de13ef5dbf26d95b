/* Polynomials through timed samples; see fit.h. */
#include "fit.h"

#include <math.h>
#include <string.h>

/* Numbers of samples of the fits. */
static const index_t WINDOWS[FIT_WINDOWS] = {1, 2, 3, 4, 5, 6, 7, 8, 12, 18, 27};
/* Part of a pivot below which it is rounding. */
#define SINGULAR 1e-12
/* Mean square of an error that is rounding of the samples.  Every fit has it, and more of it if it
 * is of more samples: of those that are exact, the one with fewest samples counts. */
#define ROUNDING 1e-18
/* An error counts as at most this many times the mean square of those before it. */
#define OUTLIER 100.0
/* The first error counts this many times: one may be small by chance. */
#define FIRST 4.0

typedef struct {
    double gram[FIT_TERMS][FIT_TERMS], right[FIT_TERMS][3];
} equations_t;

static double *fit_of(matrix_t fits, index_t window, int degree) {
    return row_of(fits, window * FIT_DEGREES + degree - 1);
}

/* Add a row of powers of u, of which the first derivative has been taken if is_rate. */
static void add_row(equations_t *e, int most, double u, bool is_rate, double weight,
                    const double *value) {
    double row[FIT_TERMS] = {0}, power = 1.0;
    for (int i = is_rate; i <= most; i++, power *= u)
        row[i] = is_rate ? i * power : power;
    for (int i = is_rate; i <= most; i++) {
        for (int j = is_rate; j <= i; j++)
            e->gram[i][j] += weight * row[i] * row[j];
        for (int k = 0; k < 3; k++)
            e->right[i][k] += weight * row[i] * value[k];
    }
}

/* Factor the equations in place (Cholesky), and solve the first triangle.
 *
 * The leading part of the factor is that of each lower degree.  Returns the largest degree. */
static int factor(equations_t *e, int most) {
    for (int i = 0; i <= most; i++) {
        double *row = e->gram[i], whole = row[i];
        for (int j = 0; j <= i; j++) {
            double sum = row[j];
            for (int k = 0; k < j; k++)
                sum -= row[k] * e->gram[j][k];
            if (j < i)
                row[j] = sum / e->gram[j][j];
            else if (sum > SINGULAR * whole)
                row[i] = sqrt(sum);
            else
                return i - 1;
        }
        for (int c = 0; c < 3; c++) {
            double sum = e->right[i][c];
            for (int k = 0; k < i; k++)
                sum -= row[k] * e->right[k][c];
            e->right[i][c] = sum / row[i];
        }
    }
    return most;
}

/* Solve the second triangle for a degree, and write the polynomial by powers of t.
 *
 * u is 1 + t / unit. */
static void write_fit(const equations_t *e, int degree, double unit, const double *rate,
                      double *fit) {
    double b[FIT_TERMS][3] = {{0}}, scale = 1.0;
    for (int i = degree; i >= 0; i--)
        for (int c = 0; c < 3; c++) {
            double sum = e->right[i][c];
            for (int k = i + 1; k <= degree; k++)
                sum -= e->gram[k][i] * b[k][c];
            b[i][c] = sum / e->gram[i][i];
        }
    for (int i = 0; i < degree; i++)
        for (int k = degree - 1; k >= i; k--)
            for (int c = 0; c < 3; c++)
                b[k][c] += b[k + 1][c];
    for (int i = 0; i < FIT_TERMS; i++, scale /= unit)
        for (int c = 0; c < 3; c++)
            fit[3 * i + c] = scale * b[i][c];
    for (int c = 0; c < 3; c++)
        fit[3 + c] += rate[c];
}

void fit_samples(matrix_t samples, double trust, matrix_t fits) {
    bool has_rates = samples.m == FIT_SAMPLE_WITH_RATE;
    const double *newest = row_of(samples, 0);
    for (index_t i = 0; i < FITS; i++)
        row_of(fits, i)[0] = NAN;
    if (has_rates) {
        double *fit = fit_of(fits, 0, 1);
        memset(fit, 0, FIT_NUMBERS * sizeof(double));
        memcpy(fit, newest + 1, 6 * sizeof(double));
    }
    for (index_t window = 1; window < FIT_WINDOWS && WINDOWS[window] <= samples.n; window++) {
        index_t count = WINDOWS[window];
        const double *oldest = row_of(samples, count - 1);
        double unit = 0.5 * (newest[0] - oldest[0]), rate[3];
        int most = (int)least(FIT_DEGREES, count * (has_rates ? 2 : 1) - 1);
        equations_t equations = {0};
        /* Without the mean rate, rounding of a steady motion is nothing. */
        for (int c = 0; c < 3; c++)
            rate[c] = (newest[1 + c] - oldest[1 + c]) / (newest[0] - oldest[0]);
        for (index_t i = 0; i < count; i++) {
            const double *sample = row_of(samples, i);
            double t = sample[0] - newest[0], u = 1.0 + t / unit, value[3];
            for (int c = 0; c < 3; c++)
                value[c] = sample[1 + c] - rate[c] * t;
            add_row(&equations, most, u, false, 1.0, value);
            if (has_rates) {
                for (int c = 0; c < 3; c++)
                    value[c] = unit * (sample[4 + c] - rate[c]);
                add_row(&equations, most, u, true, trust * trust / unit / unit, value);
            }
        }
        most = factor(&equations, most);
        for (int degree = 1; degree <= most; degree++)
            write_fit(&equations, degree, unit, rate, fit_of(fits, window, degree));
    }
}

void read_fit(row_t polynomial, double t, row_t forecast) {
    for (int c = 0; c < 3; c++) {
        double p = 0.0, v = 0.0, a = 0.0, j = 0.0;
        for (int i = FIT_TERMS - 1; i >= 0; i--) {
            j = j * t + 3.0 * a, a = a * t + 2.0 * v, v = v * t + p;
            p = p * t + polynomial.v[3 * i + c];
        }
        forecast.v[c] = p, forecast.v[3 + c] = v, forecast.v[6 + c] = a, forecast.v[9 + c] = j;
    }
}

void score_fits(matrix_t fits, double t, row_t value, double learning, matrix_t scores) {
    for (index_t i = 0; i < FITS; i++) {
        double *fit = row_of(fits, i), *score = row_of(scores, i), error = 0.0;
        if (isnan(fit[0]))
            continue;
        for (int c = 0; c < 3; c++) {
            double p = 0.0;
            for (int k = FIT_TERMS - 1; k >= 0; k--)
                p = p * t + fit[3 * k + c];
            error += (value.v[c] - p) * (value.v[c] - p);
        }
        score[1] += 1.0;
        if (score[1] == 1.0)
            score[0] = FIRST * error;
        else
            score[0] += larger(1.0 / score[1], learning)
                        * (smaller(error, OUTLIER * score[0] + ROUNDING) - score[0]);
    }
}

void mix_fits(matrix_t fits, matrix_t scores, row_t mean) {
    double total = 0.0;
    memset(mean.v, 0, FIT_NUMBERS * sizeof(double));
    const double *simplest = NULL;
    for (index_t i = 0; i < FITS; i++) {
        const double *fit = row_of(fits, i), *score = row_of(scores, i);
        if (isnan(fit[0]))
            continue;
        simplest = simplest ? simplest : fit;
        if (score[1] == 0.0)
            continue;
        double error = score[0] + ROUNDING * (double)(1 + i / FIT_DEGREES);
        double weight = 1.0 / (error * error);
        weight *= weight, weight *= weight;
        total += weight;
        for (int k = 0; k < FIT_NUMBERS; k++)
            mean.v[k] += weight * fit[k];
    }
    for (int k = 0; k < FIT_NUMBERS; k++)
        mean.v[k] = total > 0.0 ? mean.v[k] / total : simplest ? simplest[k] : 0.0;
}
