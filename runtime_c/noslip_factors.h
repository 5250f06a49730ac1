/*
 * noslip_factors.h - a covariance as P = U D U', with U upper triangular with ones on its diagonal, and D diagonal and positive.
 *
 * Packed by columns: those of U above its diagonal, and in place of the one the entry of D. Rounding cannot make a variance
 * negative. noslip_ekf.h and noslip_adaptation.h use it.
 */
#ifndef NOSLIP_FACTORS_H
#define NOSLIP_FACTORS_H

#include "noslip_real.h"

/* -- double: generated from noslip_factors.inc by guarantees/headers.py ------------------------------------------------ */

/*
 * Updates the factors of `states` states by one number, z = h'x with variance r (Bierman 1977): h has `entries`, those of the
 * other states are 0. Writes the gain times the innovation's variance, which it returns.
 */
static inline double noslip_factors_update(double *factors, int states, const double *h, int entries,
                                 double r, double *gain)
{
    double alpha = r;
    int i, j;
    for (j = 0; j < states; j++) {
        double *column = &factors[j * (j + 1) / 2];
        double f = j < entries ? h[j] : 0, v, next, back;
        for (i = 0; i < j && i < entries; i++) {
            f += column[i] * h[i];
        }
        v = column[j] * f;
        next = alpha + f * v;
        back = f / alpha;
        column[j] *= alpha / next;
        for (i = 0; i < j; i++) {
            const double u = column[i];
            column[i] = u - back * gain[i];
            gain[i] += u * v;
        }
        gain[j] = v;
        alpha = next;
    }
    return alpha;
}

/* Returns the variance of a state. */
static inline double noslip_factors_variance(const double *factors, int states, int state)
{
    double variance = factors[state * (state + 1) / 2 + state];
    int j;
    for (j = state + 1; j < states; j++) {
        const double *column = &factors[j * (j + 1) / 2];
        variance += column[state] * column[j] * column[state];
    }
    return variance;
}

/* -- float: generated from noslip_factors.inc by guarantees/headers.py ------------------------------------------------- */

/*
 * Updates the factors of `states` states by one number, z = h'x with variance r (Bierman 1977): h has `entries`, those of the
 * other states are 0. Writes the gain times the innovation's variance, which it returns.
 */
static inline float noslip_factors_update_f(float *factors, int states, const float *h, int entries,
                                float r, float *gain)
{
    float alpha = r;
    int i, j;
    for (j = 0; j < states; j++) {
        float *column = &factors[j * (j + 1) / 2];
        float f = j < entries ? h[j] : 0, v, next, back;
        for (i = 0; i < j && i < entries; i++) {
            f += column[i] * h[i];
        }
        v = column[j] * f;
        next = alpha + f * v;
        back = f / alpha;
        column[j] *= alpha / next;
        for (i = 0; i < j; i++) {
            const float u = column[i];
            column[i] = u - back * gain[i];
            gain[i] += u * v;
        }
        gain[j] = v;
        alpha = next;
    }
    return alpha;
}

/* Returns the variance of a state. */
static inline float noslip_factors_variance_f(const float *factors, int states, int state)
{
    float variance = factors[state * (state + 1) / 2 + state];
    int j;
    for (j = state + 1; j < states; j++) {
        const float *column = &factors[j * (j + 1) / 2];
        variance += column[state] * column[j] * column[state];
    }
    return variance;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
