/*
 * balance.c - state feedback about rest for EVA, in the scalar REAL with SUFFIX: arbitrary bits in all arguments.
 *
 * Proved is that nothing undefined happens, what init establishes, and that no array is left.
 */
#include "eva.h"
#include "noslip_balance.h"

#define STATES 4
#define INPUTS 2

int main(void)
{
    OF(noslip_balance_options) options;
    OF(noslip_balance) self;
    REAL K[STATES * INPUTS], rest[INPUTS], limit[INPUTS], fallen[STATES], state[STATES], desired[STATES], tau[INPUTS] = {0, 0};
    int status;
    ANY(options);
    ANY(self);
    ANY(K);
    ANY(rest);
    ANY(limit);
    ANY(fallen);
    ANY(state);
    ANY(desired);
    options.states = Frama_C_interval(-1, STATES);
    options.inputs = Frama_C_interval(-1, INPUTS);
    options.K = K;
    options.rest = rest;
    options.limit = any_int ? limit : NULL;
    options.fallen = any_int ? fallen : NULL;
    status = OF(noslip_balance_init)(&self, &options);
    if (status == NOSLIP_OK) {
        REACHED(init_good);
        /*@ assert self.ready == NOSLIP_READY; */
        status = OF(noslip_balance_step)(&self, state, desired, tau);
        if (status >= 0) {
            REACHED(step_good);
        } else {
            REACHED(step_refused);
        }
    } else {
        REACHED(init_refused);
        /*@ assert self.ready == 0; */
    }
    REACHED(end);
    return 0;
}
