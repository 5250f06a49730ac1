/*
 * law_fuzz.h - shared by all inclusions of law_fuzz.inc and runtime_fuzz.inc.
 *
 * Numbers are random from a seed, or read from the bytes chosen by a fuzzer.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "law_names.h"

#define CHECK(condition) \
    if (!(condition)) { \
        fprintf(stderr, "%s: step %lu, status %d, line %d: not %s\n", name, (unsigned long)i, status, __LINE__, #condition); \
        exit(1); \
    }

#define LANES 3 /* of a batch law: the last states */

typedef struct {
    uint64_t random;     /* state of the generator, if there are no bytes */
    const uint8_t *next; /* bytes, or NULL */
    size_t left;         /* remaining bytes */
} fuzz_source;

static inline int fuzz_more(const fuzz_source *from)
{
    return from->next == NULL || from->left > 0;
}

/* The given number of bits, at the lower end; zeros after the last byte. */
static inline uint64_t fuzz_bits(fuzz_source *from, int count)
{
    uint64_t bits = 0;
    int i;
    if (from->next == NULL) {
        return trig_random(&from->random) >> (64 - count);
    }
    for (i = 0; i < count; i += 8) {
        bits = bits << 8 | (from->left > 0 ? *from->next : 0);
        from->next += from->left > 0;
        from->left -= from->left > 0;
    }
    return bits & UINT64_MAX >> (64 - count);
}

/* 1 with probability 1 / `rare`; a fuzzer chooses freely. */
static inline int fuzz_once_in(fuzz_source *from, unsigned rare)
{
    return from->next == NULL ? fuzz_bits(from, 31) < (1u << 31) / rare : fuzz_bits(from, 8) >= 192;
}

/* Arbitrary bits, special numbers or ordinary numbers, equally often. */
static inline double fuzz_wild(fuzz_source *from, size_t size)
{
    static const double special[] = {0.0,       -0.0,      1.0,   -1.0,  1e-30, 1e30, 8192.0,  8193.0,
                                     1048576.0, 1048577.0, 1e-45, 3e38, 1e308, 5e-324, INFINITY, NAN};
    const unsigned kind = (unsigned)fuzz_bits(from, 8);
    if (kind % 3 == 0 && size == sizeof(float)) {
        noslip_bits_f any;
        any.bits = (uint32_t)fuzz_bits(from, 32);
        return (double)any.value;
    }
    if (kind % 3 == 0) {
        noslip_bits any;
        any.bits = fuzz_bits(from, 64);
        return any.value;
    }
    return kind % 3 == 1 ? special[fuzz_bits(from, 4)] : 3 * ((double)fuzz_bits(from, 16) / 32768 - 1);
}

/* An ordinary number between -3 and 3. */
static inline double fuzz_plain(fuzz_source *from)
{
    return 3 * ((double)fuzz_bits(from, 24) / 8388608 - 1);
}
