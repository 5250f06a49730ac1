/*
 * trig_digest.h - digest of the bits of noslip_sincos, noslip_sqrt, noslip_atan2 and the functions of noslip_functions.h,
 * float and double, over n seeded arguments.
 * It needs no library, so that a bare target can compute it too, for comparison.
 */
#ifndef TRIG_DIGEST_H
#define TRIG_DIGEST_H

#include "noslip_functions.h"
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

/* All NaNs count as the same. */
static inline uint64_t trig_number(uint64_t hash, double x)
{
    noslip_bits v;
    v.value = x;
    return trig_fnv(hash, x <= 0 || x > 0 ? v.bits : 0);
}

/* Digest for x, of moderate size, and u, in [-1, 1]. */
static inline uint64_t trig_functions(uint64_t hash, double x, double u)
{
    const double found[] = {noslip_exp(x), noslip_log(x), noslip_log(u * u), noslip_sinh(x), noslip_cosh(x), noslip_tanh(u * 4.0),
        noslip_atan(x), noslip_asin(u), noslip_acos(u), noslip_pow(noslip_abs(x), u * 3.0), noslip_pow(x, u), noslip_sign(x),
        noslip_min(x, u), noslip_max(x, u), noslip_less(x, u), noslip_not(x), noslip_if(noslip_less(u, 0), x)};
    const float x_f = (float)x, u_f = (float)u;
    const float found_f[] = {noslip_exp_f(x_f), noslip_log_f(x_f), noslip_log_f(u_f * u_f), noslip_sinh_f(x_f), noslip_cosh_f(x_f),
        noslip_tanh_f(u_f * 4.0f), noslip_atan_f(x_f), noslip_asin_f(u_f), noslip_acos_f(u_f),
        noslip_pow_f(noslip_abs_f(x_f), u_f * 3.0f), noslip_pow_f(x_f, u_f), noslip_sign_f(x_f), noslip_min_f(x_f, u_f),
        noslip_max_f(x_f, u_f), noslip_less_f(x_f, u_f), noslip_not_f(x_f), noslip_if_f(noslip_less_f(u_f, 0), x_f)};
    unsigned k;
    for (k = 0; k < sizeof found / sizeof *found; k++) {
        hash = trig_number(trig_number(hash, found[k]), (double)found_f[k]);
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
        hash = trig_functions(hash, x * (1.0 / 1024.0), (double)x_f * (1.0 / 8192.0));
        hash = trig_fnv(trig_fnv(trig_fnv(hash, s.bits), c.bits), root.bits);
        hash = trig_fnv(trig_fnv(hash, (uint64_t)s_f.bits << 32 | c_f.bits), root_f.bits);
    }
    return hash;
}

#endif
