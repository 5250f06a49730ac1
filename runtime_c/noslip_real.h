/*
 * noslip_real.h - arithmetic shared by the float and the double functions.
 *
 * Every target must give the same bits. This requires IEEE 754 operations, each rounded once, in the order written.
 * Compiler settings that would silently violate this are rejected here.
 */
#ifndef NOSLIP_REAL_H
#define NOSLIP_REAL_H

#include <float.h>
#include <stdint.h>

/* Fast-math and its parts reorder sums and assume that there is no NaN: tests for finite input would be removed. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0) || \
    defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__) || defined(_M_FP_FAST)
#error "noslip: compile without -ffast-math, -Ofast and their parts"
#endif

/* 0: each operation in its own type. 16 and 32 widen only types narrower than float. The others (1, 2, 64 and -1, which
 * means unknown) may round twice, as the x87 does: use -msse2 -mfpmath=sse there. */
#if !defined(FLT_EVAL_METHOD) || (FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16 && FLT_EVAL_METHOD != 32)
#error "noslip: float and double must be evaluated in their own precision (FLT_EVAL_METHOD 0)"
#endif

#if FLT_RADIX != 2 || FLT_MANT_DIG != 24 || DBL_MANT_DIG != 53
#error "noslip: float and double must be IEEE 754 binary32 and binary64"
#endif

/* No macro indicates -fsingle-precision-constant, which would round every double constant to float. */
typedef char noslip_double_constants_are_double[sizeof(1.0) == sizeof(double) ? 1 : -1];

/*
 * a * b + c must not be fused into one operation, which is rounded once instead of twice and gives other bits. By default GCC fuses
 * in C++ and with -std=gnu99, gnu11 ..., clang within an expression. The pragmas below prevent this up to the end of the file that
 * includes this header, in every dialect: in this package's functions and in those that inline them, including link-time
 * optimization. (GCC inlines a function with such a pragma only into functions with the same one. It ignores the standard pragma.)
 * Not prevented: clang's -ffp-contract=fast, which overrides its pragmas and defines no macro. The self-test detects it.
 */
#if defined(__clang__)
#if defined(__cplusplus)
#pragma clang fp contract(off)
#else
#pragma STDC FP_CONTRACT OFF
#endif
#elif defined(__GNUC__)
#if !defined(__FRAMAC__)
#pragma GCC optimize("fp-contract=off", "no-tree-loop-distribute-patterns") /* the second: loops are not replaced by calls of memset */
#if defined(NOSLIP_QUICK) && defined(__OPTIMIZE_SIZE__)
#pragma GCC optimize("O2")
#define NOSLIP_SMALL __attribute__((cold))
#endif
#endif
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#else
#pragma STDC FP_CONTRACT OFF
#endif

/* Files that define NOSLIP_QUICK contain the steps of laws. Where GCC is asked for small code, -Os, it compiles these files for speed,
 * except what is NOSLIP_SMALL. */
#if !defined(NOSLIP_SMALL)
#define NOSLIP_SMALL
#endif

/* GCC and clang have these built in and need no header, which bare WebAssembly does not have. */
#if defined(__GNUC__) && !defined(__FRAMAC__)
#define NOSLIP_BUILTIN(name) __builtin_##name
#else
#include <math.h>
#define NOSLIP_BUILTIN(name) name
#endif

/*
 * Without instructions for a type, a comparison of its numbers is a call; magnitudes are compared there as the integers that have
 * their bits, with the same result. NOSLIP_SOFT: use integers, here and for the square root, on every target.
 */
#if !defined(__FRAMAC__)
#if defined(NOSLIP_SOFT) || (defined(__riscv) && !defined(__riscv_flen)) || (defined(__arm__) && !defined(__ARM_FP))
#define NOSLIP_INTEGERS_F
#define NOSLIP_INTEGERS
#elif (defined(__riscv_flen) && __riscv_flen < 64) || (defined(__arm__) && !(__ARM_FP & 8))
#define NOSLIP_INTEGERS
#endif
#endif

typedef union {
    float value;
    uint32_t bits;
} noslip_bits_f;

typedef union {
    double value;
    uint64_t bits;
} noslip_bits;

/* Returns 1 if x is neither infinite nor NaN, else 0. */
static inline int noslip_is_finite(double x)
{
#if defined(NOSLIP_INTEGERS)
    noslip_bits v;
    v.value = x;
    return (v.bits & 0x7ff0000000000000u) != 0x7ff0000000000000u;
#else
    return NOSLIP_BUILTIN(isfinite)(x) != 0;
#endif
}

static inline int noslip_is_finite_f(float x)
{
#if defined(NOSLIP_INTEGERS_F)
    noslip_bits_f v;
    v.value = x;
    return (v.bits & 0x7f800000u) != 0x7f800000u;
#else
    return NOSLIP_BUILTIN(isfinite)(x) != 0;
#endif
}

/* Returns 1 if x is finite and positive, else 0. */
static inline int noslip_is_positive(double x)
{
#if defined(__FRAMAC__) /* the other form does not exclude NaN in its intervals */
    return noslip_is_finite(x) && x > 0;
#else
    return x > 0 && x <= DBL_MAX;
#endif
}

static inline int noslip_is_positive_f(float x)
{
#if defined(__FRAMAC__)
    return noslip_is_finite_f(x) && x > 0;
#else
    return x > 0 && x <= FLT_MAX;
#endif
}

/* Returns 1 if the sum of the three is finite, which implies that each is: one test instead of three. Returns 0 otherwise, also if
 * only the sum overflows. */
static inline int noslip_sum_finite(double x, double y, double z)
{
#if defined(__FRAMAC__) /* its intervals cannot infer the terms from the sum */
    return noslip_is_finite(x) && noslip_is_finite(y) && noslip_is_finite(z);
#else
    return noslip_is_finite(x + y + z);
#endif
}

static inline int noslip_sum_finite_f(float x, float y, float z)
{
#if defined(__FRAMAC__)
    return noslip_is_finite_f(x) && noslip_is_finite_f(y) && noslip_is_finite_f(z);
#else
    return noslip_is_finite_f(x + y + z);
#endif
}

static inline double noslip_abs(double x)
{
    return NOSLIP_BUILTIN(fabs)(x);
}

static inline float noslip_abs_f(float x)
{
    return NOSLIP_BUILTIN(fabsf)(x);
}

/* Returns 1 if |x| <= limit, else 0; 0 for NaN. The limit is not -0: each init refuses it, or stores what it means instead. */
static inline int noslip_within(double x, double limit)
{
#if defined(__FRAMAC__) /* equivalent, in a form that its intervals can follow */
    return noslip_is_finite(x) && x >= -limit && x <= limit;
#elif defined(NOSLIP_INTEGERS)
    noslip_bits v, most;
    v.value = x;
    most.value = limit;
    return (v.bits & 0x7fffffffffffffffu) <= most.bits && most.bits <= 0x7ff0000000000000u;
#else
    return noslip_abs(x) <= limit;
#endif
}

static inline int noslip_within_f(float x, float limit)
{
#if defined(__FRAMAC__)
    return noslip_is_finite_f(x) && x >= -limit && x <= limit;
#elif defined(NOSLIP_INTEGERS_F)
    noslip_bits_f v, most;
    v.value = x;
    most.value = limit;
    return (v.bits & 0x7fffffffu) <= most.bits && most.bits <= 0x7f800000u;
#else
    return noslip_abs_f(x) <= limit;
#endif
}

/*
 * Square root, correctly rounded (to nearest, ties to even) on every target: the instruction where there is one, never the
 * library's function, which sets errno. NaN for negative x; -0 for -0.
 *
 * The routines in integers are for targets without the instruction. They find the root bit by bit, as on paper: shift two
 * bits of the radicand into the remainder, try a one as the next bit of the root. One bit more than the type holds decides
 * the rounding; a tie is impossible, because the square of an odd root would be odd and the radicand here is even.
 */
static inline float noslip_soft_sqrt_f(float x)
{
    noslip_bits_f v;
    uint32_t fraction, root = 0, rest = 0;
    int exponent, i;

    v.value = x;
    if ((v.bits & 0x7fffffffu) == 0 || v.bits == 0x7f800000u) { /* zeros and +infinity */
        return x;
    }
    if (v.bits > 0x7f800000u) { /* NaN and everything negative */
        v.bits = 0x7fc00000u;
        return v.value;
    }
    exponent = (int)(v.bits >> 23);
    fraction = v.bits & 0x7fffffu;
    if (exponent > 0) {
        fraction |= 0x800000u;
    } else { /* subnormal: normalize the fraction */
        for (exponent = 1; fraction < 0x800000u; exponent--) {
            fraction <<= 1;
        }
    }
    exponent -= 127; /* x = fraction 2^(exponent - 23) */
    fraction <<= 7 + (exponent & 1); /* the radicand's 25 bits at the top of 32 */
    for (i = 0; i < 25; i++) {
        rest = rest << 2 | fraction >> 30;
        fraction <<= 2;
        root <<= 1;
        if (rest >= (root << 1 | 1)) {
            rest -= root << 1 | 1;
            root |= 1;
        }
    }
    v.bits = ((root + 1) >> 1) + ((uint32_t)((exponent - (exponent & 1)) / 2 + 126) << 23);
    return v.value;
}

static inline double noslip_soft_sqrt(double x)
{
    noslip_bits v;
    uint64_t fraction, root = 0, rest = 0;
    int exponent, i;

    v.value = x;
    if ((v.bits & 0x7fffffffffffffffu) == 0 || v.bits == 0x7ff0000000000000u) {
        return x;
    }
    if (v.bits > 0x7ff0000000000000u) {
        v.bits = 0x7ff8000000000000u;
        return v.value;
    }
    exponent = (int)(v.bits >> 52);
    fraction = v.bits & 0xfffffffffffffu;
    if (exponent > 0) {
        fraction |= 0x10000000000000u;
    } else {
        for (exponent = 1; fraction < 0x10000000000000u; exponent--) {
            fraction <<= 1;
        }
    }
    exponent -= 1023;
    fraction <<= 10 + (exponent & 1);
    for (i = 0; i < 54; i++) {
        rest = rest << 2 | fraction >> 62;
        fraction <<= 2;
        root <<= 1;
        if (rest >= (root << 1 | 1)) {
            rest -= root << 1 | 1;
            root |= 1;
        }
    }
    v.bits = ((root + 1) >> 1) + ((uint64_t)((exponent - (exponent & 1)) / 2 + 1022) << 52);
    return v.value;
}

/* A number without its lower half of bits (Veltkamp): 12 of 24 remain in float, 26 of 53 in double. */
static inline float noslip_upper_half_f(float x)
{
    const float larger = x * 4097.0f;
    return larger - (larger - x);
}

static inline double noslip_upper_half(double x)
{
    const double larger = x * 134217729.0;
    return larger - (larger - x);
}

/* The square root instruction of the target. */
#if defined(__FRAMAC__) /* analysis only: Frama-C knows sqrt exactly, but loses a float made from bits */
#define NOSLIP_SQRT_SET_F(root, x) (root) = sqrtf(x)
#define NOSLIP_SQRT_SET(root, x) (root) = sqrt(x)
#elif defined(NOSLIP_SOFT)
#elif defined(__SSE2__) && defined(__GNUC__) /* the intrinsics cost GCC two moves more */
#if defined(__AVX__)
#define NOSLIP_SQRT_SET_F(root, x) __asm__("vsqrtss %1, %1, %0" : "=x"(root) : "x"(x))
#define NOSLIP_SQRT_SET(root, x) __asm__("vsqrtsd %1, %1, %0" : "=x"(root) : "x"(x))
#else
#define NOSLIP_SQRT_SET_F(root, x) __asm__("sqrtss %1, %0" : "=x"(root) : "x"(x))
#define NOSLIP_SQRT_SET(root, x) __asm__("sqrtsd %1, %0" : "=x"(root) : "x"(x))
#endif
#elif defined(_M_X64)
#include <emmintrin.h>
#define NOSLIP_SQRT_INTRINSIC
#elif defined(__aarch64__) && defined(__ARM_FP)
#define NOSLIP_SQRT_SET_F(root, x) __asm__("fsqrt %s0, %s1" : "=w"(root) : "w"(x))
#define NOSLIP_SQRT_SET(root, x) __asm__("fsqrt %d0, %d1" : "=w"(root) : "w"(x))
#elif defined(__arm__) && defined(__ARM_FP)
#if (__ARM_FP & 4)
#define NOSLIP_SQRT_SET_F(root, x) __asm__("vsqrt.f32 %0, %1" : "=t"(root) : "t"(x))
#endif
#if (__ARM_FP & 8)
#define NOSLIP_SQRT_SET(root, x) __asm__("vsqrt.f64 %P0, %P1" : "=w"(root) : "w"(x))
#endif
#elif defined(__riscv_flen)
#if __riscv_flen >= 32
#define NOSLIP_SQRT_SET_F(root, x) __asm__("fsqrt.s %0, %1" : "=f"(root) : "f"(x))
#endif
#if __riscv_flen >= 64
#define NOSLIP_SQRT_SET(root, x) __asm__("fsqrt.d %0, %1" : "=f"(root) : "f"(x))
#endif
#elif defined(__wasm__)
#define NOSLIP_SQRT_SET_F(root, x) __asm__("local.get %1\n\tf32.sqrt\n\tlocal.set %0" : "=r"(root) : "r"(x))
#define NOSLIP_SQRT_SET(root, x) __asm__("local.get %1\n\tf64.sqrt\n\tlocal.set %0" : "=r"(root) : "r"(x))
#endif

static inline float noslip_sqrt_f(float x)
{
#if defined(NOSLIP_SQRT_INTRINSIC)
    return _mm_cvtss_f32(_mm_sqrt_ss(_mm_set_ss(x)));
#elif defined(NOSLIP_SQRT_SET_F)
    float root;
    NOSLIP_SQRT_SET_F(root, x);
    return root;
#else
    return noslip_soft_sqrt_f(x);
#endif
}

static inline double noslip_sqrt(double x)
{
#if defined(NOSLIP_SQRT_INTRINSIC)
    const __m128d v = _mm_set_sd(x);
    return _mm_cvtsd_f64(_mm_sqrt_sd(v, v));
#elif defined(NOSLIP_SQRT_SET)
    double root;
    NOSLIP_SQRT_SET(root, x);
    return root;
#else
    return noslip_soft_sqrt(x);
#endif
}

#endif
