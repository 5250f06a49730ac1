/*
 * noslip_adaptation.h - parameters that change, such as a payload, by recursive least squares.
 *
 * The reduced dynamics (10), S'MS nudot + bias = S'E tau, are affine in masses and inertias. Each call gives one such equation
 * for each quasi-velocity. They are smoothed, both sides alike, and the parameters minimize the squares of their errors, of which
 * the old ones are forgotten:
 *
 *     status = labmate_adaptation_init(&adaptation, &config);
 *     status = labmate_adaptation_step(&adaptation, &state, tau, dt, &params);   at each call; tau: the inputs since the last
 *     status = labmate_follower_update(&follower, &params, &gains, &limits);     now and then, or init and update of a law
 *
 * An equation that holds within the dead zone teaches nothing, and nothing is then forgotten: neither is what a motion
 * does not show. The estimates stay within their bounds, and what is in use follows them slowly.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_ADAPTATION_H
#define NOSLIP_ADAPTATION_H

#include "noslip_controller.h"
#include "noslip_factors.h"

#define NOSLIP_ADAPTED 4 /* parameters at most */
#define NOSLIP_ADAPTED_ROWS 4 /* equations at most: quasi-velocities */
#define NOSLIP_ADAPTED_FACTORS (NOSLIP_ADAPTED * (NOSLIP_ADAPTED + 1) / 2)

/* -- double: generated from noslip_adaptation.inc by guarantees/headers.py --------------------------------------------- */

/* Options of the adaptation. Parameters are relative to their bounds: 0 is the least, 1 the most. */
typedef struct noslip_adaptation_options {
    double sd;              /* of each parameter at first, relative to its bounds, 1e-6 to 1; it does not become larger */
    double noise;           /* N or N m, positive: standard deviation of an equation */
    double dead_zone;       /* N or N m: nothing is learned where all equations hold within it; 0: none */
    double forgetting;      /* s: what is so old counts for 1/e; 0: nothing is forgotten */
    double window;          /* s, positive: equations are smoothed over about so long, which should be 5 calls or more */
    double rate;            /* 1/s: by so much a parameter in use changes at most, relative to its bounds */
} noslip_adaptation_options;

/* The adaptation: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_adaptation {
    noslip_adaptation_options options;
    double estimate[NOSLIP_ADAPTED];                           /* 0 to 1 */
    double used[NOSLIP_ADAPTED];                               /* follows the estimate at `rate` */
    double factors[NOSLIP_ADAPTED_FACTORS];                    /* covariance, see noslip_factors.h */
    double regressor[NOSLIP_ADAPTED_ROWS * NOSLIP_ADAPTED];      /* smoothed, row major */
    double target[NOSLIP_ADAPTED_ROWS];                        /* smoothed */
    int count; /* number of parameters */
    int rows;  /* number of equations */
    int ready;
} noslip_adaptation;

/*
 * Initializes with the parameters `start` (count; 0 to 1) of `rows` equations. Returns NOSLIP_BAD_PARAMETER unless all options
 * are in their ranges, start within its bounds, and count and rows at least 1 and at most NOSLIP_ADAPTED and NOSLIP_ADAPTED_ROWS.
 */
NOSLIP_NODISCARD static inline int noslip_adaptation_init(noslip_adaptation *self,
                                             const noslip_adaptation_options *options,
                                             const double *start, int count, int rows)
{
    int i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (options == NULL || start == NULL) {
        return NOSLIP_NULL;
    }
    if (!(options->sd >= (double)1e-6 && options->sd <= 1 && options->noise >= (double)1e-6 &&
          options->noise <= (double)1e6 && noslip_is_limit(options->dead_zone) &&
          noslip_is_limit(options->forgetting) && noslip_is_positive(options->window) &&
          noslip_is_positive(options->rate) && count >= 1 && count <= NOSLIP_ADAPTED && rows >= 1 &&
          rows <= NOSLIP_ADAPTED_ROWS)) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_is_finite(start[i]) && start[i] >= 0 && start[i] <= 1)) {
            return NOSLIP_BAD_PARAMETER;
        }
    }
    self->options.sd = options->sd;
    self->options.noise = options->noise;
    self->options.dead_zone = options->dead_zone > 0 ? options->dead_zone : 0; /* not -0 */
    self->options.forgetting = options->forgetting;
    self->options.window = options->window;
    self->options.rate = options->rate;
    for (i = 0; i < NOSLIP_ADAPTED_FACTORS; i++) {
        self->factors[i] = 0;
    }
    for (i = 0; i < NOSLIP_ADAPTED; i++) {
        self->estimate[i] = i < count ? start[i] : 0;
        self->used[i] = self->estimate[i];
        self->factors[i * (i + 1) / 2 + i] = options->sd * options->sd;
    }
    for (i = 0; i < NOSLIP_ADAPTED_ROWS * NOSLIP_ADAPTED; i++) {
        self->regressor[i] = 0;
    }
    for (i = 0; i < NOSLIP_ADAPTED_ROWS; i++) {
        self->target[i] = 0;
    }
    self->count = count;
    self->rows = rows;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the part of the target that the parameters do not explain. */
static inline double noslip_adaptation_error(const double *regressor, double target,
                                   const double *parameters, int count)
{
    int k;
    for (k = 0; k < count; k++) {
        target -= regressor[k] * parameters[k];
    }
    return target;
}

/* Divides the covariance by `keeps`, at most 1, unless a variance would then exceed that at first. */
static inline void noslip_adaptation_forget(const noslip_adaptation *self, double keeps, double *factors)
{
    const double most = keeps * self->options.sd * self->options.sd;
    int k;
    for (k = 0; k < self->count; k++) {
        if (!(noslip_factors_variance(factors, self->count, k) <= most)) {
            return;
        }
    }
    for (k = 0; k < self->count; k++) {
        factors[k * (k + 1) / 2 + k] /= keeps;
    }
}

/* Corrects estimate and factors by the equations, one after the other. */
static inline void noslip_adaptation_learn(const noslip_adaptation *self, const double *regressor,
                         const double *target, double *estimate, double *factors)
{
    const double variance = self->options.noise * self->options.noise;
    double gain[NOSLIP_ADAPTED];
    int i, k;
    for (i = 0; i < self->rows; i++) {
        const double *row = &regressor[i * self->count];
        const double error = noslip_adaptation_error(row, target[i], estimate, self->count);
        const double step =
            error / noslip_factors_update(factors, self->count, row, self->count, variance, gain);
        for (k = 0; k < self->count; k++) {
            estimate[k] += gain[k] * step;
        }
    }
}

/*
 * Learns from the equations regressor[rows][count] parameters = target[rows], N or N m, where all factors are relative to the
 * bounds, which held within the last dt (s); see `estimate` and `used`. On an error nothing changes: NOSLIP_NULL;
 * NOSLIP_NOT_READY; NOSLIP_NONFINITE, also if a result overflows; NOSLIP_BAD_PARAMETER (dt).
 */
static inline int noslip_adaptation_step(noslip_adaptation *self, const double *regressor,
                       const double *target, double dt)
{
    double smooth[NOSLIP_ADAPTED_ROWS * NOSLIP_ADAPTED], wanted[NOSLIP_ADAPTED_ROWS], factors[NOSLIP_ADAPTED_FACTORS];
    double estimate[NOSLIP_ADAPTED], keeps, most, sum = 0;
    int i, size, entries, learns = 0;
    if (self == NULL || regressor == NULL || target == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite(dt)) {
        return NOSLIP_NONFINITE;
    }
    if (!(dt > 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    size = self->count * (self->count + 1) / 2;
    entries = self->rows * self->count;
    keeps = self->options.window / (self->options.window + dt);
    for (i = 0; i < entries; i++) {
        smooth[i] = regressor[i] + keeps * (self->regressor[i] - regressor[i]);
        sum += smooth[i];
    }
    for (i = 0; i < size; i++) {
        factors[i] = self->factors[i];
    }
    for (i = 0; i < self->count; i++) {
        estimate[i] = self->estimate[i];
    }
    for (i = 0; i < self->rows; i++) {
        double error;
        wanted[i] = target[i] + keeps * (self->target[i] - target[i]);
        sum += wanted[i];
        error = noslip_adaptation_error(&smooth[i * self->count], wanted[i], estimate, self->count);
        learns = learns || !noslip_within(error, self->options.dead_zone);
    }
    if (learns) {
        if (self->options.forgetting > 0) {
            noslip_adaptation_forget(self, self->options.forgetting / (self->options.forgetting + dt), factors);
        }
        noslip_adaptation_learn(self, smooth, wanted, estimate, factors);
    }
    for (i = 0; i < size; i++) {
        sum += factors[i];
    }
    if (!(noslip_all_finite(estimate, self->count) && noslip_is_finite(sum))) {
        return NOSLIP_NONFINITE;
    }
    most = self->options.rate * dt;
    for (i = 0; i < self->count; i++) {
        self->estimate[i] = estimate[i] > 0 ? (estimate[i] < 1 ? estimate[i] : 1) : 0;
        self->used[i] += noslip_clip(self->estimate[i] - self->used[i], most);
    }
    for (i = 0; i < size; i++) {
        self->factors[i] = factors[i];
    }
    for (i = 0; i < entries; i++) {
        self->regressor[i] = smooth[i];
    }
    for (i = 0; i < self->rows; i++) {
        self->target[i] = wanted[i];
    }
    return NOSLIP_OK;
}

/* Returns a parameter that goes from `least` (0) to `most` (1), within both in spite of rounding. */
static inline double noslip_adaptation_value(double part, double least, double most)
{
    const double value = least + part * (most - least);
    return value < least ? least : value > most ? most : value;
}

/* -- float: generated from noslip_adaptation.inc by guarantees/headers.py ---------------------------------------------- */

/* Options of the adaptation. Parameters are relative to their bounds: 0 is the least, 1 the most. */
typedef struct noslip_adaptation_options_f {
    float sd;               /* of each parameter at first, relative to its bounds, 1e-6 to 1; it does not become larger */
    float noise;            /* N or N m, positive: standard deviation of an equation */
    float dead_zone;        /* N or N m: nothing is learned where all equations hold within it; 0: none */
    float forgetting;       /* s: what is so old counts for 1/e; 0: nothing is forgotten */
    float window;           /* s, positive: equations are smoothed over about so long, which should be 5 calls or more */
    float rate;             /* 1/s: by so much a parameter in use changes at most, relative to its bounds */
} noslip_adaptation_options_f;

/* The adaptation: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_adaptation_f {
    noslip_adaptation_options_f options;
    float estimate[NOSLIP_ADAPTED];                            /* 0 to 1 */
    float used[NOSLIP_ADAPTED];                                /* follows the estimate at `rate` */
    float factors[NOSLIP_ADAPTED_FACTORS];                     /* covariance, see noslip_factors.h */
    float regressor[NOSLIP_ADAPTED_ROWS * NOSLIP_ADAPTED];       /* smoothed, row major */
    float target[NOSLIP_ADAPTED_ROWS];                         /* smoothed */
    int count; /* number of parameters */
    int rows;  /* number of equations */
    int ready;
} noslip_adaptation_f;

/*
 * Initializes with the parameters `start` (count; 0 to 1) of `rows` equations. Returns NOSLIP_BAD_PARAMETER unless all options
 * are in their ranges, start within its bounds, and count and rows at least 1 and at most NOSLIP_ADAPTED and NOSLIP_ADAPTED_ROWS.
 */
NOSLIP_NODISCARD static inline int noslip_adaptation_init_f(noslip_adaptation_f *self,
                                                 const noslip_adaptation_options_f *options,
                                                 const float *start, int count, int rows)
{
    int i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (options == NULL || start == NULL) {
        return NOSLIP_NULL;
    }
    if (!(options->sd >= (float)1e-6 && options->sd <= 1 && options->noise >= (float)1e-6 &&
          options->noise <= (float)1e6 && noslip_is_limit_f(options->dead_zone) &&
          noslip_is_limit_f(options->forgetting) && noslip_is_positive_f(options->window) &&
          noslip_is_positive_f(options->rate) && count >= 1 && count <= NOSLIP_ADAPTED && rows >= 1 &&
          rows <= NOSLIP_ADAPTED_ROWS)) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < count; i++) {
        if (!(noslip_is_finite_f(start[i]) && start[i] >= 0 && start[i] <= 1)) {
            return NOSLIP_BAD_PARAMETER;
        }
    }
    self->options.sd = options->sd;
    self->options.noise = options->noise;
    self->options.dead_zone = options->dead_zone > 0 ? options->dead_zone : 0; /* not -0 */
    self->options.forgetting = options->forgetting;
    self->options.window = options->window;
    self->options.rate = options->rate;
    for (i = 0; i < NOSLIP_ADAPTED_FACTORS; i++) {
        self->factors[i] = 0;
    }
    for (i = 0; i < NOSLIP_ADAPTED; i++) {
        self->estimate[i] = i < count ? start[i] : 0;
        self->used[i] = self->estimate[i];
        self->factors[i * (i + 1) / 2 + i] = options->sd * options->sd;
    }
    for (i = 0; i < NOSLIP_ADAPTED_ROWS * NOSLIP_ADAPTED; i++) {
        self->regressor[i] = 0;
    }
    for (i = 0; i < NOSLIP_ADAPTED_ROWS; i++) {
        self->target[i] = 0;
    }
    self->count = count;
    self->rows = rows;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the part of the target that the parameters do not explain. */
static inline float noslip_adaptation_error_f(const float *regressor, float target,
                                  const float *parameters, int count)
{
    int k;
    for (k = 0; k < count; k++) {
        target -= regressor[k] * parameters[k];
    }
    return target;
}

/* Divides the covariance by `keeps`, at most 1, unless a variance would then exceed that at first. */
static inline void noslip_adaptation_forget_f(const noslip_adaptation_f *self, float keeps, float *factors)
{
    const float most = keeps * self->options.sd * self->options.sd;
    int k;
    for (k = 0; k < self->count; k++) {
        if (!(noslip_factors_variance_f(factors, self->count, k) <= most)) {
            return;
        }
    }
    for (k = 0; k < self->count; k++) {
        factors[k * (k + 1) / 2 + k] /= keeps;
    }
}

/* Corrects estimate and factors by the equations, one after the other. */
static inline void noslip_adaptation_learn_f(const noslip_adaptation_f *self, const float *regressor,
                            const float *target, float *estimate, float *factors)
{
    const float variance = self->options.noise * self->options.noise;
    float gain[NOSLIP_ADAPTED];
    int i, k;
    for (i = 0; i < self->rows; i++) {
        const float *row = &regressor[i * self->count];
        const float error = noslip_adaptation_error_f(row, target[i], estimate, self->count);
        const float step =
            error / noslip_factors_update_f(factors, self->count, row, self->count, variance, gain);
        for (k = 0; k < self->count; k++) {
            estimate[k] += gain[k] * step;
        }
    }
}

/*
 * Learns from the equations regressor[rows][count] parameters = target[rows], N or N m, where all factors are relative to the
 * bounds, which held within the last dt (s); see `estimate` and `used`. On an error nothing changes: NOSLIP_NULL;
 * NOSLIP_NOT_READY; NOSLIP_NONFINITE, also if a result overflows; NOSLIP_BAD_PARAMETER (dt).
 */
static inline int noslip_adaptation_step_f(noslip_adaptation_f *self, const float *regressor,
                          const float *target, float dt)
{
    float smooth[NOSLIP_ADAPTED_ROWS * NOSLIP_ADAPTED], wanted[NOSLIP_ADAPTED_ROWS], factors[NOSLIP_ADAPTED_FACTORS];
    float estimate[NOSLIP_ADAPTED], keeps, most, sum = 0;
    int i, size, entries, learns = 0;
    if (self == NULL || regressor == NULL || target == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite_f(dt)) {
        return NOSLIP_NONFINITE;
    }
    if (!(dt > 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    size = self->count * (self->count + 1) / 2;
    entries = self->rows * self->count;
    keeps = self->options.window / (self->options.window + dt);
    for (i = 0; i < entries; i++) {
        smooth[i] = regressor[i] + keeps * (self->regressor[i] - regressor[i]);
        sum += smooth[i];
    }
    for (i = 0; i < size; i++) {
        factors[i] = self->factors[i];
    }
    for (i = 0; i < self->count; i++) {
        estimate[i] = self->estimate[i];
    }
    for (i = 0; i < self->rows; i++) {
        float error;
        wanted[i] = target[i] + keeps * (self->target[i] - target[i]);
        sum += wanted[i];
        error = noslip_adaptation_error_f(&smooth[i * self->count], wanted[i], estimate, self->count);
        learns = learns || !noslip_within_f(error, self->options.dead_zone);
    }
    if (learns) {
        if (self->options.forgetting > 0) {
            noslip_adaptation_forget_f(self, self->options.forgetting / (self->options.forgetting + dt), factors);
        }
        noslip_adaptation_learn_f(self, smooth, wanted, estimate, factors);
    }
    for (i = 0; i < size; i++) {
        sum += factors[i];
    }
    if (!(noslip_all_finite_f(estimate, self->count) && noslip_is_finite_f(sum))) {
        return NOSLIP_NONFINITE;
    }
    most = self->options.rate * dt;
    for (i = 0; i < self->count; i++) {
        self->estimate[i] = estimate[i] > 0 ? (estimate[i] < 1 ? estimate[i] : 1) : 0;
        self->used[i] += noslip_clip_f(self->estimate[i] - self->used[i], most);
    }
    for (i = 0; i < size; i++) {
        self->factors[i] = factors[i];
    }
    for (i = 0; i < entries; i++) {
        self->regressor[i] = smooth[i];
    }
    for (i = 0; i < self->rows; i++) {
        self->target[i] = wanted[i];
    }
    return NOSLIP_OK;
}

/* Returns a parameter that goes from `least` (0) to `most` (1), within both in spite of rounding. */
static inline float noslip_adaptation_value_f(float part, float least, float most)
{
    const float value = least + part * (most - least);
    return value < least ? least : value > most ? most : value;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
