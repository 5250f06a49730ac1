/*
 * trig_digest.h - one number for the bits of noslip_sincos and noslip_sqrt, float and double, over n seeded arguments.
 * No library needed, so that a bare target computes it too and the numbers can be compared.
 */
#ifndef TRIG_DIGEST_H
#define TRIG_DIGEST_H

#include "noslip_trig.h"

/* xorshift64*; the state must not be 0 */
static inline uint64_t trig_random(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return *state * 0x2545f4914f6cdd1du;
}

/* FNV-1a, lowest byte first on every target */
static inline uint64_t trig_fnv(uint64_t hash, uint64_t bits)
{
    int i;
    for (i = 0; i < 8; i++) {
        hash = (hash ^ (bits >> 8 * i & 0xff)) * 0x100000001b3u;
    }
    return hash;
}

static inline uint64_t trig_digest(uint32_t n, uint64_t seed)
{
    uint64_t hash = 0xcbf29ce484222325u, state = seed * 2 + 1;
    while (n-- > 0) {
        const uint64_t u = trig_random(&state);
        /* the whole range, thinned out towards zero by powers of two; every conversion is exact */
        const double scale = 1.0 / (double)(1u << (u & 15));
        const double x = ((double)(int64_t)(u >> 11) - 4503599627370496.0) * (1.0 / 4294967296.0) * scale;
        const float x_f = ((float)(int32_t)(u >> 40) - 8388608.0f) * (1.0f / 1024.0f) * (float)scale;
        noslip_bits s, c, root, angle;
        noslip_bits_f s_f, c_f, root_f, angle_f;
        noslip_sincos(x, &s.value, &c.value);
        noslip_sincos_f(x_f, &s_f.value, &c_f.value);
        root.value = noslip_sqrt(noslip_abs(x));
        root_f.value = noslip_sqrt_f(noslip_abs_f(x_f));
        angle.value = noslip_atan2(x, (double)x_f);
        angle_f.value = noslip_atan2_f(x_f, (float)(int32_t)(u >> 32));
        hash = trig_fnv(trig_fnv(hash, angle.bits), angle_f.bits);
        hash = trig_fnv(trig_fnv(trig_fnv(hash, s.bits), c.bits), root.bits);
        hash = trig_fnv(trig_fnv(hash, (uint64_t)s_f.bits << 32 | c_f.bits), root_f.bits);
    }
    return hash;
}

#endif
