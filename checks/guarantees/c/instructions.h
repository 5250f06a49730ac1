/* instructions.h - shared by all inclusions of instructions.inc. */
#include "law_names.h"

#define SUFFIX _f
#define REAL float
#define ONCE __attribute__((noipa)) /* GCC: not inlined, cloned or analysed for its caller */

int status_of_last;

/* Mostly between -4 and 4; a few are zero, tiny, beyond the range of angles, overflow in float, or have arbitrary bits. */
static float any_value(uint64_t *random)
{
    const uint64_t kind = trig_random(random) >> 54; /* 0 to 1023 */
    noslip_bits_f value;
    if (kind == 0) {
        value.bits = (uint32_t)(trig_random(random) >> 32);
        return value.value;
    }
    value.value = (float)random_unit(random);
    return value.value * (kind == 1 ? 1e30f : kind < 6 ? 16384.0f : kind < 16 ? 0.0f : kind < 32 ? 1e-6f : 4.0f);
}

/* Positive numbers between 0.5 and 4. */
static void fill(uint64_t *random, int any, float *values, int count)
{
    while (count-- > 0) {
        values[count] = any ? any_value(random) : 2.25f + 1.75f * (float)random_unit(random);
    }
}
