/*
 * noslip_controller.h - what surrounds a generated law and makes it a controller: finite input, limits, a safe answer.
 *
 * Each function exists for double and, with the suffix _f, for float; both come from noslip_controller.inc.
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

/* What a step does with inputs beyond their limits. */
enum {
    NOSLIP_CUT = 0, /* cuts each input by itself */
    NOSLIP_SLOW = 1 /* gives up the wanted speed, so that the other outputs get what they ask for: a path is kept */
};

/* What a step does when something is wrong stays out of the way of what it does when nothing is: NOSLIP_COLD, in a header
 * NOSLIP_APART. What every step runs through is NOSLIP_HOT. */
#if defined(__GNUC__)
#define NOSLIP_COLD __attribute__((noinline, cold))
#define NOSLIP_APART static inline __attribute__((cold))
#define NOSLIP_HOT static inline __attribute__((always_inline))
#else
#define NOSLIP_COLD
#define NOSLIP_APART static inline
#define NOSLIP_HOT static inline
#endif

#define NOSLIP_REAL double
#define NOSLIP_LARGEST DBL_MAX
#define NOSLIP_NAME(name) name
#include "noslip_controller.inc"
#undef NOSLIP_REAL
#undef NOSLIP_LARGEST
#undef NOSLIP_NAME

#define NOSLIP_REAL float
#define NOSLIP_LARGEST FLT_MAX
#define NOSLIP_NAME(name) name##_f
#include "noslip_controller.inc"
#undef NOSLIP_REAL
#undef NOSLIP_LARGEST
#undef NOSLIP_NAME

#endif
