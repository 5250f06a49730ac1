/*
 * instructions_adaptation.c - steps of the adaptation, to be counted. A file of its own: what the compiler puts inline elsewhere
 * does not depend on it.
 */
#include "noslip_adaptation.h"
#include "trig_digest.h"

#define ONCE __attribute__((noipa)) /* GCC: not inlined, cloned or analysed for its caller */

void count_adaptation(uint32_t n);
static int status_of_last;

/* Between -1 and 1. */
static float unit(uint64_t *random)
{
    return (float)((double)(trig_random(random) >> 32) / 2147483648.0 - 1);
}

ONCE void adaptation_step(noslip_adaptation_f *self, const float *regressor, const float *target)
{
    status_of_last = noslip_adaptation_step_f(self, regressor, target, 0.015625f);
}

#define CALLER(kind) \
    ONCE void adaptation_##kind(noslip_adaptation_f *self, const float *regressor, const float *target) \
    { \
        adaptation_step(self, regressor, target); \
        status_of_last += 0; \
    }
CALLER(look)
CALLER(learns)
CALLER(quiet)
CALLER(refused)
#undef CALLER

/* Two parameters of two equations, of which half are within the dead zone, and now and then one is not a number. */
void count_adaptation(uint32_t n)
{
    static const noslip_adaptation_options_f options = {0.3f, 0.2f, 0.125f, 20, 0.1f, 0.1f};
    static const float start[2] = {0.25f, 0.75f};
    noslip_adaptation_f self, copy;
    uint64_t random = 1978;
    uint32_t i;

    if (noslip_adaptation_init_f(&self, &options, start, 2, 2) < 0) {
        return;
    }
    for (i = 0; i < n; i++) {
        const float scale = i / 64 % 2 > 0 ? 0.001f : 1;
        float regressor[4], target[2];
        int k;
        for (k = 0; k < 4; k++) {
            regressor[k] = scale * 4 * unit(&random);
        }
        for (k = 0; k < 2; k++) {
            target[k] = 0.5f * (regressor[2 * k] + regressor[2 * k + 1]) + scale * unit(&random);
        }
        if (i % 256 == 255) {
            target[1] = (float)1e30 * (float)1e30;
        }
        copy = self;
        adaptation_look(&copy, regressor, target);
        (status_of_last < 0 ? adaptation_refused : copy.factors[0] != self.factors[0] ? adaptation_learns : adaptation_quiet)(
            &self, regressor, target);
    }
}
