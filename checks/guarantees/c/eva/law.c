/*
 * law.c - the law LAW of ROBOT for EVA, in the scalar REAL with SUFFIX: its init, a step, every other function. FOLLOWS is 1
 * if it has the step function follow, EXTENDED is 1 if it has a dynamic extension, GRIPS is 1 if it can keep wheels rolling.
 *
 * A step is proved to keep the properties that init establishes for limits and held inputs, so that the results for one step hold for
 * any sequence of steps.
 */
#include "eva.h"
#include HEADER

#define OF_LAW(name) OF(GLUE(LAW, name))
#define OF_ROBOT(name) OF(GLUE(ROBOT, name))
#define INPUTS COUNT(((OF_LAW() *)0)->held)

/* init with arbitrary bits in all arguments: an error and a law that is not ready, or valid limits and no held inputs. */
void check_init(int with_options)
{
    OF_ROBOT(_params) params;
    OF_LAW(_config) config;
    OF_LAW(_gains) gains;
    OF_ROBOT(_options) options;
    OF_LAW() law;
    int status, k;
    ANY(params);
    ANY(config);
    ANY(gains);
    ANY(options);
    ANY(law);
    status = OF_LAW(_init)(&law, &params, &config, &gains, with_options ? &options : NULL);
    if (status < 0) {
        REACHED(init_refused);
        /*@ assert law.ready == 0; */
    } else {
        REACHED(init_good);
        /*@ assert status == NOSLIP_OK && law.ready == NOSLIP_READY; */
        /*@ assert law.on_error == NOSLIP_ZERO || law.on_error == NOSLIP_HOLD; */
        for (k = 0; k < INPUTS; k++) {
            /*@ assert \is_finite(law.limit[k]) && law.limit[k] > 0; */
            /*@ assert law.held[k] == 0; */
        }
    }
}

/*
 * step or follow, with arbitrary bits in state, reference, foot, tau, and in the law except for its limits, held inputs, on_error and
 * friction. Limits are specific numbers: intervals cannot show that a torque is below a limit if neither is known.
 */
void check_step(int follow, int grip, int on_error, REAL odd, REAL even, REAL held_least, REAL held_most)
{
    OF_ROBOT(_state) state;
    OF_LAW(_reference) reference;
    OF(noslip_foot) foot;
    OF_LAW() law;
    REAL tau[INPUTS];
    const REAL dt = EXTENDED ? any_real() : 0;
    int status, k;
    ANY(state);
    ANY(reference);
    ANY(foot);
    ANY(law);
    ANY(tau);
    law.on_error = on_error;
    for (k = 0; k < INPUTS; k++) {
        law.limit[k] = k % 2 ? odd : even;
#if GRIPS
        law.clear[k] = grip ? -1 : law.limit[k];
#endif
        law.held[k] = BETWEEN(held_least, held_most);
    }
#if GRIPS
    if (grip) {
        law.on_limit = NOSLIP_GRIP;
        law.grip.weight = BETWEEN(0, 1000);
        law.grip.height = BETWEEN(0, 1000);
    }
#endif
#if FOLLOWS
    if (follow) {
        status = OF_LAW(_follow)(&law, &foot, &state, &reference, tau);
        if (status == NOSLIP_OK) {
            REACHED(follow_good);
        } else if (status > 0) {
            REACHED(follow_saturated);
        } else {
            REACHED(follow_refused);
        }
    } else
#endif
    {
#if EXTENDED
        status = OF_LAW(_step)(&law, &state, &reference, dt, tau);
        for (k = 0; k < COUNT(law.extension); k++) {
            /*@ assert status >= 0 ==> \is_finite(law.extension[k]) && \is_finite(law.extension_rate[k]); */
        }
#else
        status = OF_LAW(_step)(&law, &state, &reference, tau);
#endif
        if (status == NOSLIP_OK) {
            REACHED(step_good);
        } else if (status > 0) {
            REACHED(step_saturated);
        } else {
            REACHED(step_refused);
        }
    }
    /*@ assert status <= NOSLIP_WILL_SLIP && status >= NOSLIP_NOT_READY; */
    /*@ assert status == NOSLIP_BAD_PARAMETER ==> dt < 0; */
    /*@ assert status >= 0 ==> law.ready == NOSLIP_READY; */
    for (k = 0; k < INPUTS; k++) {
        const REAL limit = k % 2 ? odd : even;
        /*@ assert \is_finite(tau[k]) && -limit <= tau[k] <= limit; */
        /*@ assert \is_finite(law.held[k]) && -limit <= law.held[k] <= limit; */
        /*@ assert law.limit[k] == limit; */
        if (status < 0) {
            REACHED(held_on_an_error);
            /*@ assert law.held[k] >= held_least && law.held[k] <= held_most; */
            /*@ assert (on_error == NOSLIP_ZERO || status == NOSLIP_NOT_READY) ==> tau[k] == 0; */
            /*@ assert on_error == NOSLIP_HOLD && status != NOSLIP_NOT_READY ==> held_least <= tau[k] <= held_most; */
        }
    }
}

/* Asserts that the numbers are finite, or zero with an error. */
void check_answer(const REAL *values, int count, int status)
{
    int k;
    for (k = 0; k < count; k++) {
        /*@ assert status >= 0 ==> \is_finite(values[k]); */
        /*@ assert status < 0 ==> values[k] == 0; */
    }
}

/* Every other function, with arbitrary bits in all arguments: finite numbers, or an error and zeros. */
void check_functions(void)
{
    OF_ROBOT(_state) state;
    OF_LAW(_reference) reference;
    OF_LAW() law;
    OF_LAW(_evaluation) all;
    REAL v[INPUTS];
    int status, k;
    ANY(state);
    ANY(reference);
    ANY(law);
    ANY(all);
    ANY(v);
    status = OF_LAW(_output)(&law, &state, all.h);
    if (status >= 0) {
        REACHED(output_good);
    } else {
        REACHED(output_refused);
    }
    check_answer(all.h, COUNT(all.h), status);
    status = OF_LAW(_rate)(&law, &state, all.ydot);
    if (status >= 0) {
        REACHED(rate_good);
    } else {
        REACHED(rate_refused);
    }
    check_answer(all.ydot, COUNT(all.ydot), status);
    status = OF_LAW(_decoupling)(&law, &state, all.Phi);
    if (status >= 0) {
        REACHED(decoupling_good);
    } else {
        REACHED(decoupling_refused);
    }
    check_answer(all.Phi[0], (int)(sizeof all.Phi / sizeof(REAL)), status);
#if !EXTENDED
    status = OF_LAW(_decoupling_rate)(&law, &state, all.Phidot);
    if (status >= 0) {
        REACHED(decoupling_rate_good);
    } else {
        REACHED(decoupling_rate_refused);
    }
    check_answer(all.Phidot[0], (int)(sizeof all.Phidot / sizeof(REAL)), status);
#endif
    status = OF_LAW(_feedback)(&law, &state, v, all.tau);
    if (status >= 0) {
        REACHED(feedback_good);
    } else {
        REACHED(feedback_refused);
    }
    check_answer(all.tau, INPUTS, status);
    ANY(all);
    status = OF_LAW(_evaluate)(&law, &state, &reference, &all);
    if (status >= 0) {
        REACHED(evaluate_good);
    } else {
        REACHED(evaluate_refused);
    }
    check_answer((const REAL *)&all, (int)(sizeof all / sizeof(REAL)), status);
    status = OF_LAW(_reset)(&law);
    /*@ assert status == NOSLIP_OK && law.held[0] == 0; */
}

int main(void)
{
    int follow;
    check_init(0);
    check_init(1);
    for (follow = 0; follow <= FOLLOWS; follow++) {
        check_step(follow, 0, NOSLIP_ZERO, SMALLEST, LARGEST, -SMALLEST, SMALLEST);
        check_step(follow, 0, NOSLIP_ZERO, LARGEST, SMALLEST, -SMALLEST, SMALLEST);
        check_step(follow, 0, NOSLIP_HOLD, 20, 7, -7, 7);
        check_step(follow, 0, NOSLIP_HOLD, 20, 7, 3, 3);
#if GRIPS
        check_step(follow, 1, NOSLIP_HOLD, 20, 7, -7, 7);
#endif
    }
    check_functions();
    REACHED(end);
    return 0;
}
