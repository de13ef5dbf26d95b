/* Polynomials through timed samples of a vector, and how well each has foretold the next sample.
 *
 * A fit is a polynomial through the newest few samples by least squares: FIT_WINDOWS numbers of
 * samples, each with degrees from 1 to FIT_DEGREES.  Few samples and a high degree follow a smooth
 * motion; many samples and a low degree average noise.  Each fit keeps the mean square of its
 * errors in foretelling samples.  The forecast is the mean of all fits.  Each has the inverse eighth
 * power of that as its weight, so the motion itself decides.  A lower power lets too many poor fits
 * count: under noise, good and poor ones differ by little.
 *
 * A polynomial is FIT_TERMS rows of three numbers, by powers of the time in s. */
#ifndef ORIENTD_FIT_H
#define ORIENTD_FIT_H

#include "arrays.h"

enum {
    FIT_WINDOWS = 11, FIT_DEGREES = 7, FITS = FIT_WINDOWS * FIT_DEGREES,
    FIT_TERMS = FIT_DEGREES + 1, FIT_NUMBERS = 3 * FIT_TERMS,
    /* Of a sample: its time, its value, and its rate if it has one. */
    FIT_SAMPLE = 4, FIT_SAMPLE_WITH_RATE = 7,
    /* Of a fit: the mean square of its errors, and their number. */
    FIT_SCORE = 2,
    /* Of a forecast: value, rate and its first two derivatives. */
    FORECAST = 12,
};

/* Write all fits; the first number of a fit is NaN if its samples are too few.
 *
 * samples: newest first, times ascending by their distance from the newest; at least one.
 * trust: time for which a rate counts more than a value, s. */
void fit_samples(matrix_t samples, double trust, matrix_t fits);

/* Note how well fits have foretold the value of a sample at a time; each counts by learning. */
void score_fits(matrix_t fits, double t, row_t value, double learning, matrix_t scores);

/* Write the mean of all fits, weighted by their scores; the simplest fit if none has a score. */
void mix_fits(matrix_t fits, matrix_t scores, row_t mean);

/* Write value, rate and its first two derivatives of a polynomial at a time. */
void read_fit(row_t polynomial, double t, row_t forecast);

#endif
