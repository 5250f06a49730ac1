/*
 * noslip_controller.h - checks around a generated law: finite arguments, limits, safe outputs.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_CONTROLLER_H
#define NOSLIP_CONTROLLER_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"
#include "noslip_trig.h"

/* The value of `ready` in a law that init has accepted: unlikely in memory that was never initialized, and an immediate
 * operand on Thumb. */
#define NOSLIP_READY 0x5e5e5e5e

/* What a step does if inputs exceed their limits. */
typedef enum noslip_on_limit {
    NOSLIP_CUT = 0,  /* limits each input separately */
    NOSLIP_SLOW = 1, /* reduces the desired acceleration, so that the other outputs, such as the path, are not affected */
    NOSLIP_GRIP = 2, /* keeps the wheels rolling and the inputs within their limits: see noslip_grip.h */
    NOSLIP_ON_LIMIT_AS_INT = -0x7fffffff
} noslip_on_limit;

/* Code that runs only on errors is kept apart from the code of every step: NOSLIP_COLD, in a header NOSLIP_APART; code that runs with
 * some options only is NOSLIP_BESIDE. Code of every step is NOSLIP_HOT. In files of the user the compiler decides whether to inline
 * it, and does not inline it into functions that fuse products; in files of this package, which define NOSLIP_OWN, it is always
 * inlined. */
#if defined(__GNUC__)
#define NOSLIP_COLD __attribute__((noinline, cold))
#define NOSLIP_BESIDE __attribute__((noinline))
#define NOSLIP_APART static inline __attribute__((cold))
#if defined(NOSLIP_OWN)
#define NOSLIP_HOT static inline __attribute__((always_inline))
#else
#define NOSLIP_HOT static inline
#endif
#else
#define NOSLIP_COLD
#define NOSLIP_BESIDE
#define NOSLIP_APART static inline
#define NOSLIP_HOT static inline
#endif

/* Copies `size` bytes, without a library. */
NOSLIP_APART void noslip_copy(void *to, const void *from, size_t size)
{
    size_t i;
    for (i = 0; i < size; i++) {
        ((unsigned char *)to)[i] = ((const unsigned char *)from)[i];
    }
}

#define NOSLIP_MODULE "noslip_controller.inc"
#include "noslip_scalars.inc"

#endif
