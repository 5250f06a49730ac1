/*
 * noslip_lanes.h - for the batch laws, files whose names end in _steps: what lets compilers compute several lanes at once.
 *
 * The bits are the same with and without vector instructions: a root is an instruction of its own in vectors too. GCC computes the
 * roots of a law in vectors only with -fno-math-errno; other compilers than GCC and clang may compute one lane after the other.
 */
#ifndef NOSLIP_LANES_H
#define NOSLIP_LANES_H

#include "noslip_controller.h"

#define NOSLIP_LANES 64 /* steps computed in one loop, whose results are kept on the stack */

/* Roots without inline assembly, which no compiler can put into vectors, where they are an instruction. */
#if defined(__clang__) && defined(__SSE2__) /* not its built-in function, which sets errno */
#include <emmintrin.h>
static inline float noslip_lane_sqrt_f(float x)
{
    return _mm_cvtss_f32(_mm_sqrt_ss(_mm_set_ss(x)));
}
static inline double noslip_lane_sqrt(double x)
{
    const __m128d v = _mm_set_sd(x);
    return _mm_cvtsd_f64(_mm_sqrt_sd(v, v));
}
#elif defined(__GNUC__) && defined(__SSE2__) && defined(__NO_MATH_ERRNO__)
#define noslip_lane_sqrt_f __builtin_sqrtf
#define noslip_lane_sqrt __builtin_sqrt
#else
#define noslip_lane_sqrt_f noslip_sqrt_f
#define noslip_lane_sqrt noslip_sqrt
#endif

#endif
