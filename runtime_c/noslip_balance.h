/*
 * noslip_balance.h - linear state feedback about rest, for robots with fewer inputs than degrees of freedom, such as a balancer.
 *
 *     tau = rest - K (state - desired)
 *
 * with the gains K of an LQR at rest; `noslip generate balancer --lqr pitch=10 x=40 ...` writes them as a header. The position is compared in axes along the desired heading, so that gains that were found at heading 0 hold for any.
 *
 *     noslip_balance_f balance;
 *     status = balancer_lqr_init_f(&balance);
 *     status = noslip_balance_step_f(&balance, state, desired, tau);
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_BALANCE_H
#define NOSLIP_BALANCE_H

#include "noslip_controller.h"

#define NOSLIP_BALANCE_STATES 64 /* at most */
#define NOSLIP_BALANCE_INPUTS 8  /* at most */

/* -- double: generated from noslip_balance.inc by guarantees/headers.py ------------------------------------------------ */

/* Gains and what they are about. Arrays live as long as the feedback. */
typedef struct noslip_balance_options {
    int states, inputs;        /* how many there are, at least 1 */
    const double *K;           /* inputs x states, row-major: on the deviation from the desired state */
    const double *rest;        /* N or N m: inputs that hold the robot at rest */
    const double *limit;       /* N or N m: of each input, 0: no limit; NULL: none has one */
    const double *fallen;      /* deviation of each state beyond which the robot has fallen, 0: any; NULL: any of all states */
    int x, y, heading;         /* numbers of the states that are a position in the plane and the heading; heading -1: none */
} noslip_balance_options;

/* A feedback: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_balance {
    noslip_balance_options options;
    int ready;
} noslip_balance;

/* Returns 1 if `count` numbers are finite and, unless `any`, not negative. */
static inline int noslip_balance_numbers(const double *numbers, int count, int any)
{
    int k, good = 1;
    for (k = 0; k < count && good; k++) {
        good = noslip_is_finite(numbers[k]) && (any || numbers[k] >= 0);
    }
    return good;
}

/*
 * Initializes. Returns NOSLIP_NULL for a null pointer, NOSLIP_BAD_PARAMETER for sizes below 1, a number of a state that there is
 * not, numbers that are not finite, and limits that are negative.
 */
NOSLIP_NODISCARD static inline int noslip_balance_init(noslip_balance *self,
                                          const noslip_balance_options *options)
{
    int good;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (options == NULL || options->K == NULL || options->rest == NULL) {
        return NOSLIP_NULL;
    }
    good = options->states >= 1 && options->inputs >= 1 && options->heading < options->states && options->heading >= -1;
    good = good && (options->heading < 0 || (options->x >= 0 && options->x < options->states && options->y >= 0 &&
                                             options->y < options->states && options->x != options->y));
    good = good && options->states <= NOSLIP_BALANCE_STATES && options->inputs <= NOSLIP_BALANCE_INPUTS &&
           noslip_balance_numbers(options->K, options->states * options->inputs, 1) &&
           noslip_balance_numbers(options->rest, options->inputs, 1);
    good = good && (options->limit == NULL || noslip_balance_numbers(options->limit, options->inputs, 0));
    good = good && (options->fallen == NULL || noslip_balance_numbers(options->fallen, options->states, 0));
    if (!good) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->options.states = options->states;
    self->options.inputs = options->inputs;
    self->options.K = options->K;
    self->options.rest = options->rest;
    self->options.limit = options->limit;
    self->options.fallen = options->fallen;
    self->options.x = options->x;
    self->options.y = options->y;
    self->options.heading = options->heading;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the deviation of a state; of a position in axes along the desired heading, whose sine and cosine are given; of the
 * heading the smallest. */
static inline double noslip_balance_off(const noslip_balance_options *options,
                           const double *state, const double *desired, double sine,
                           double cosine, int k)
{
    const double own = state[k] - desired[k];
    if (options->heading < 0) {
        return own;
    }
    if (k == options->x) {
        return cosine * own + sine * (state[options->y] - desired[options->y]);
    }
    if (k == options->y) {
        return cosine * own - sine * (state[options->x] - desired[options->x]);
    }
    return k == options->heading ? own - (double)6.283185307179586 * noslip_whole_turns(own)
                                 : own;
}

/* Returns an input without its limit. */
static inline double noslip_balance_input(const noslip_balance_options *options,
                             const double *state, const double *desired,
                             double sine, double cosine, int input)
{
    double sum = options->rest[input];
    int k;
    for (k = 0; k < options->states; k++) {
        sum -= options->K[input * options->states + k] * noslip_balance_off(options, state, desired, sine, cosine, k);
    }
    return sum;
}

/* Computes the inputs of a step into `tau`, of NOSLIP_BALANCE_INPUTS numbers, and returns its status. */
static inline int noslip_balance_inputs(const noslip_balance_options *options, const double *state,
                      const double *desired, double *tau)
{
    double sine = 0, cosine = 1;
    int k, status = NOSLIP_OK;
    if (!noslip_balance_numbers(state, options->states, 1) ||
        !noslip_balance_numbers(desired, options->states, 1)) {
        return NOSLIP_NONFINITE;
    }
    if (options->heading >= 0) {
        if (!noslip_angle_ok(state[options->heading]) || !noslip_angle_ok(desired[options->heading])) {
            return NOSLIP_RANGE;
        }
        noslip_sincos(desired[options->heading], &sine, &cosine);
    }
    for (k = 0; k < options->states && options->fallen != NULL; k++) {
        const double off = noslip_balance_off(options, state, desired, sine, cosine, k);
        if (options->fallen[k] > 0 && !(noslip_abs(off) <= options->fallen[k])) {
            return NOSLIP_ASTRAY;
        }
    }
    for (k = 0; k < options->inputs; k++) {
        const double limit = noslip_limit(options->limit != NULL ? options->limit[k] : (double)0);
        const double input = noslip_balance_input(options, state, desired, sine, cosine, k);
        if (!noslip_is_finite(input)) {
            return NOSLIP_NONFINITE;
        }
        tau[k] = noslip_clip(input, limit);
        status = noslip_within(input, limit) ? status : NOSLIP_SATURATED;
    }
    return status;
}

/*
 * Writes the inputs, N or N m, at a `state` = [q; nu], of which `desired` is what is desired: at rest somewhere, or moving slowly.
 * Returns NOSLIP_SATURATED if an input was limited. On an error the inputs are zero: NOSLIP_NULL, NOSLIP_NOT_READY,
 * NOSLIP_NONFINITE, NOSLIP_RANGE for a heading, NOSLIP_ASTRAY if the robot has fallen.
 */
NOSLIP_NODISCARD static inline int noslip_balance_step(const noslip_balance *self,
                                          const double *state, const double *desired,
                                          double *tau)
{
    double own[NOSLIP_BALANCE_INPUTS];
    int k, status;
    if (self == NULL || tau == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    for (k = 0; k < NOSLIP_BALANCE_INPUTS; k++) {
        own[k] = 0;
    }
    status = state == NULL || desired == NULL ? NOSLIP_NULL
                                              : noslip_balance_inputs(&self->options, state, desired, own);
    for (k = 0; k < self->options.inputs; k++) {
        tau[k] = status >= 0 ? own[k] : (double)0;
    }
    return status;
}

/* -- float: generated from noslip_balance.inc by guarantees/headers.py ------------------------------------------------- */

/* Gains and what they are about. Arrays live as long as the feedback. */
typedef struct noslip_balance_options_f {
    int states, inputs;        /* how many there are, at least 1 */
    const float *K;            /* inputs x states, row-major: on the deviation from the desired state */
    const float *rest;         /* N or N m: inputs that hold the robot at rest */
    const float *limit;        /* N or N m: of each input, 0: no limit; NULL: none has one */
    const float *fallen;       /* deviation of each state beyond which the robot has fallen, 0: any; NULL: any of all states */
    int x, y, heading;         /* numbers of the states that are a position in the plane and the heading; heading -1: none */
} noslip_balance_options_f;

/* A feedback: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_balance_f {
    noslip_balance_options_f options;
    int ready;
} noslip_balance_f;

/* Returns 1 if `count` numbers are finite and, unless `any`, not negative. */
static inline int noslip_balance_numbers_f(const float *numbers, int count, int any)
{
    int k, good = 1;
    for (k = 0; k < count && good; k++) {
        good = noslip_is_finite_f(numbers[k]) && (any || numbers[k] >= 0);
    }
    return good;
}

/*
 * Initializes. Returns NOSLIP_NULL for a null pointer, NOSLIP_BAD_PARAMETER for sizes below 1, a number of a state that there is
 * not, numbers that are not finite, and limits that are negative.
 */
NOSLIP_NODISCARD static inline int noslip_balance_init_f(noslip_balance_f *self,
                                              const noslip_balance_options_f *options)
{
    int good;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (options == NULL || options->K == NULL || options->rest == NULL) {
        return NOSLIP_NULL;
    }
    good = options->states >= 1 && options->inputs >= 1 && options->heading < options->states && options->heading >= -1;
    good = good && (options->heading < 0 || (options->x >= 0 && options->x < options->states && options->y >= 0 &&
                                             options->y < options->states && options->x != options->y));
    good = good && options->states <= NOSLIP_BALANCE_STATES && options->inputs <= NOSLIP_BALANCE_INPUTS &&
           noslip_balance_numbers_f(options->K, options->states * options->inputs, 1) &&
           noslip_balance_numbers_f(options->rest, options->inputs, 1);
    good = good && (options->limit == NULL || noslip_balance_numbers_f(options->limit, options->inputs, 0));
    good = good && (options->fallen == NULL || noslip_balance_numbers_f(options->fallen, options->states, 0));
    if (!good) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->options.states = options->states;
    self->options.inputs = options->inputs;
    self->options.K = options->K;
    self->options.rest = options->rest;
    self->options.limit = options->limit;
    self->options.fallen = options->fallen;
    self->options.x = options->x;
    self->options.y = options->y;
    self->options.heading = options->heading;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Returns the deviation of a state; of a position in axes along the desired heading, whose sine and cosine are given; of the
 * heading the smallest. */
static inline float noslip_balance_off_f(const noslip_balance_options_f *options,
                              const float *state, const float *desired, float sine,
                              float cosine, int k)
{
    const float own = state[k] - desired[k];
    if (options->heading < 0) {
        return own;
    }
    if (k == options->x) {
        return cosine * own + sine * (state[options->y] - desired[options->y]);
    }
    if (k == options->y) {
        return cosine * own - sine * (state[options->x] - desired[options->x]);
    }
    return k == options->heading ? own - (float)6.283185307179586 * noslip_whole_turns_f(own)
                                 : own;
}

/* Returns an input without its limit. */
static inline float noslip_balance_input_f(const noslip_balance_options_f *options,
                                const float *state, const float *desired,
                                float sine, float cosine, int input)
{
    float sum = options->rest[input];
    int k;
    for (k = 0; k < options->states; k++) {
        sum -= options->K[input * options->states + k] * noslip_balance_off_f(options, state, desired, sine, cosine, k);
    }
    return sum;
}

/* Computes the inputs of a step into `tau`, of NOSLIP_BALANCE_INPUTS numbers, and returns its status. */
static inline int noslip_balance_inputs_f(const noslip_balance_options_f *options, const float *state,
                         const float *desired, float *tau)
{
    float sine = 0, cosine = 1;
    int k, status = NOSLIP_OK;
    if (!noslip_balance_numbers_f(state, options->states, 1) ||
        !noslip_balance_numbers_f(desired, options->states, 1)) {
        return NOSLIP_NONFINITE;
    }
    if (options->heading >= 0) {
        if (!noslip_angle_ok_f(state[options->heading]) || !noslip_angle_ok_f(desired[options->heading])) {
            return NOSLIP_RANGE;
        }
        noslip_sincos_f(desired[options->heading], &sine, &cosine);
    }
    for (k = 0; k < options->states && options->fallen != NULL; k++) {
        const float off = noslip_balance_off_f(options, state, desired, sine, cosine, k);
        if (options->fallen[k] > 0 && !(noslip_abs_f(off) <= options->fallen[k])) {
            return NOSLIP_ASTRAY;
        }
    }
    for (k = 0; k < options->inputs; k++) {
        const float limit = noslip_limit_f(options->limit != NULL ? options->limit[k] : (float)0);
        const float input = noslip_balance_input_f(options, state, desired, sine, cosine, k);
        if (!noslip_is_finite_f(input)) {
            return NOSLIP_NONFINITE;
        }
        tau[k] = noslip_clip_f(input, limit);
        status = noslip_within_f(input, limit) ? status : NOSLIP_SATURATED;
    }
    return status;
}

/*
 * Writes the inputs, N or N m, at a `state` = [q; nu], of which `desired` is what is desired: at rest somewhere, or moving slowly.
 * Returns NOSLIP_SATURATED if an input was limited. On an error the inputs are zero: NOSLIP_NULL, NOSLIP_NOT_READY,
 * NOSLIP_NONFINITE, NOSLIP_RANGE for a heading, NOSLIP_ASTRAY if the robot has fallen.
 */
NOSLIP_NODISCARD static inline int noslip_balance_step_f(const noslip_balance_f *self,
                                              const float *state, const float *desired,
                                              float *tau)
{
    float own[NOSLIP_BALANCE_INPUTS];
    int k, status;
    if (self == NULL || tau == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    for (k = 0; k < NOSLIP_BALANCE_INPUTS; k++) {
        own[k] = 0;
    }
    status = state == NULL || desired == NULL ? NOSLIP_NULL
                                              : noslip_balance_inputs_f(&self->options, state, desired, own);
    for (k = 0; k < self->options.inputs; k++) {
        tau[k] = status >= 0 ? own[k] : (float)0;
    }
    return status;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
