/*
 * noise.h - normal random numbers that are a pure function of a seed and of two numbers, the same bits on every machine.
 *
 * Nothing is kept between calls, so that any number can be had at any time, on any thread. Bits come from Philox4x32-10, a
 * counter-based generator (Salmon and others, Parallel random numbers: as easy as 1, 2, 3, 2011); two numbers of 53 bits each
 * become two normal ones by the method of Box and Muller. Only + - * / and the runtime's square root, sine and cosine.
 */
#ifndef NOISE_H
#define NOISE_H

#include "noslip_trig.h"

/* Four words of 32 bits from a counter of four and a key of two. */
static inline void noise_words(const uint32_t counter[4], const uint32_t key[2], uint32_t words[4])
{
    uint32_t k0 = key[0], k1 = key[1];
    int i;
    for (i = 0; i < 4; i++) {
        words[i] = counter[i];
    }
    for (i = 0; i < 10; i++) {
        const uint64_t first = UINT64_C(0xD2511F53) * words[0], second = UINT64_C(0xCD9E8D57) * words[2];
        words[0] = (uint32_t)(second >> 32) ^ words[1] ^ k0;
        words[1] = (uint32_t)second;
        words[2] = (uint32_t)(first >> 32) ^ words[3] ^ k1;
        words[3] = (uint32_t)first;
        k0 += UINT32_C(0x9E3779B9); /* from the golden ratio and the root of 3, as published */
        k1 += UINT32_C(0xBB67AE85);
    }
}

/* The words for the pair of numbers `pair` of the draw `draw`. */
static inline void noise_block(uint64_t seed, uint64_t draw, uint32_t pair, uint32_t words[4])
{
    const uint32_t key[2] = {(uint32_t)seed, (uint32_t)(seed >> 32)};
    const uint32_t counter[4] = {(uint32_t)draw, (uint32_t)(draw >> 32), pair, 0};
    noise_words(counter, key, words);
}

/* The middle of one of 2^53 equal parts of 0 to 1, so never 0; rounding makes the last one 1. */
static inline double noise_uniform(uint32_t high, uint32_t low)
{
    return ((double)((uint64_t)(high >> 5) << 26 | low >> 6) + 0.5) * (1.0 / 9007199254740992.0);
}

/* Natural logarithm of a normal number, error a few 1e-16: x = m 2^e with m between sqrt(1/2) and sqrt(2), and
 * log m = 2 (s + s^3/3 + s^5/5 + ...) with s = (m - 1) / (m + 1), of which what comes after s^21 is below 1e-17. */
static inline double noise_log(double x)
{
    noslip_bits bits;
    double s, z, sum;
    int exponent;
    bits.value = x;
    exponent = (int)(bits.bits >> 52) - 1023;
    bits.bits = (bits.bits & UINT64_C(0xfffffffffffff)) | UINT64_C(0x3ff0000000000000);
    if (bits.value > 1.4142135623730951) {
        bits.value /= 2;
        exponent++;
    }
    s = (bits.value - 1) / (bits.value + 1);
    z = s * s;
    sum = z * (1.0 / 3 + z * (1.0 / 5 + z * (1.0 / 7 + z * (1.0 / 9 + z * (1.0 / 11 + z * (1.0 / 13 +
        z * (1.0 / 15 + z * (1.0 / 17 + z * (1.0 / 19 + z * (1.0 / 21))))))))));
    return exponent * 0.6931471805599453 + 2 * (s + s * sum);
}

/* `count` independent normal numbers, mean 0, standard deviation 1: the draw with the number `draw` of the seed. */
static inline void noise_normal(uint64_t seed, uint64_t draw, int count, double *normal)
{
    int i;
    for (i = 0; i < count; i += 2) {
        uint32_t words[4];
        double radius, sine, cosine;
        noise_block(seed, draw, (uint32_t)i / 2, words);
        radius = noslip_sqrt(-2 * noise_log(noise_uniform(words[0], words[1])));
        noslip_sincos(6.283185307179586 * noise_uniform(words[2], words[3]), &sine, &cosine);
        normal[i] = radius * cosine;
        if (i + 1 < count) {
            normal[i + 1] = radius * sine;
        }
    }
}

#endif
