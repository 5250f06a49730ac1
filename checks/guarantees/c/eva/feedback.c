/*
 * feedback.c - the generated state feedback FEEDBACK, of STATES states and INPUTS inputs, for EVA, in the scalar REAL with SUFFIX.
 *
 * Proved is that its init succeeds, and that a step with arbitrary bits in state, desired state and tau returns inputs that are finite
 * and within the limits, and zero on an error.
 */
#include "eva.h"
#include HEADER

int main(void)
{
    OF(noslip_balance) law;
    REAL state[STATES], desired[STATES], tau[INPUTS];
    int status, k;
    ANY(law);
    ANY(state);
    ANY(desired);
    ANY(tau);
    status = OF(GLUE(FEEDBACK, _init))(&law);
    /*@ assert status == NOSLIP_OK && law.ready == NOSLIP_READY; */
    REACHED(init_good);
    status = OF(noslip_balance_step)(&law, state, desired, tau);
    if (status == NOSLIP_OK) {
        REACHED(step_good);
    } else if (status > 0) {
        REACHED(step_saturated);
        /*@ assert status == NOSLIP_SATURATED; */
    } else {
        REACHED(step_refused);
        /*@ assert status == NOSLIP_NONFINITE || status == NOSLIP_RANGE || status == NOSLIP_ASTRAY; */
    }
    for (k = 0; k < INPUTS; k++) {
        const REAL limit = law.options.limit[k];
        /*@ assert \is_finite(tau[k]); */
        /*@ assert limit > 0 ==> -limit <= tau[k] <= limit; */
        /*@ assert status < 0 ==> tau[k] == 0; */
    }
    return 0;
}
