/*
 * trig_sweep.c - measures noslip_trig.h, noslip_functions.h and noslip_real.h against the host's libm.
 *
 *   trig_sweep float [stride [part parts]]   every float (or every stride-th) in range; fails above 1e-7 absolute
 *   trig_sweep double N seed                 N arguments and the neighbourhood of every multiple of pi/4 in range;
 *                                            fails above 1 ulp
 *   trig_sweep atan2 N seed                  N directions, axes, diagonals and the borders between the pieces of the
 *                                            polynomial; fails above 3e-7 (float), 4e-16 or 2.5 ulp (double)
 *   trig_sweep functions stride N seed       every stride-th float and N doubles for each function of noslip_functions.h; fails
 *                                            above the bounds stated there
 *   trig_sweep sqrt N seed                   both routines, bit for bit
 *   trig_sweep digest N seed                 digest of the bits, to compare between targets
 *
 * part of parts (0 ... parts - 1) lets several processes share the sweep. Build: -std=c99 -O2 -ffp-contract=off, -lm.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "noslip_functions.h"
#include "trig_digest.h"

#define HALF_PI_L 1.57079632679489661923132169163975144L

typedef struct {
    double error, at;
} worst;

static void note(worst *w, double error, double at)
{
    if (!(error <= w->error)) { /* a NaN counts as an error */
        w->error = error;
        w->at = at;
    }
}

static int report(const char *name, const worst *w, double limit, const char *unit)
{
    printf("%-6s max error %.4g %s at %.17g\n", name, w->error, unit, w->at);
    return !(w->error <= limit);
}

static int same_f(float a, float b)
{
    return memcmp(&a, &b, sizeof a) == 0;
}

static int same(double a, double b)
{
    return memcmp(&a, &b, sizeof a) == 0;
}

/* Whole turns of angles up to 2 rad beside them, in range. */
static int sweep_turns(void)
{
    int wrong = 0, n, k;
    for (n = -1300; n <= 1300; n++) {
        for (k = -2; k <= 2; k++) {
            const double angle = 4 * HALF_PI_L * n + k;
            wrong += !same_f(noslip_whole_turns_f((float)angle) + 0.0f, (float)n) || !same(noslip_whole_turns(angle) + 0.0, n);
        }
    }
    printf("%d wrong numbers of turns\n", wrong);
    return wrong > 0;
}

/* Negative floats need no reference: their bits are compared with those of the positive ones. */
static int sweep_float(uint32_t stride, uint32_t part, uint32_t parts)
{
    worst sine = {0, 0}, cosine = {0, 0};
    uint64_t count = 0, broken = 0, i;
    noslip_bits_f last, x;
    last.value = NOSLIP_ANGLE_MAX_F;
    for (i = (uint64_t)part * stride; i <= last.bits; i += (uint64_t)stride * parts, count++) {
        float s, c, s2, c2;
        x.bits = (uint32_t)i;
        noslip_sincos_f(x.value, &s, &c);
        noslip_sincos_f(-x.value, &s2, &c2);
        broken += !same_f(s2, -s) || !same_f(c2, c) || !(fabsf(s) <= 1.0f && fabsf(c) <= 1.0f);
        note(&sine, fabs((double)s - sin((double)x.value)), (double)x.value);
        note(&cosine, fabs((double)c - cos((double)x.value)), (double)x.value);
        if (count % (1u << 27) == 0) {
            fprintf(stderr, "%5.1f %%\n", 100.0 * (double)i / last.bits);
        }
    }
    printf("%llu floats of each sign, %llu not odd/even or above 1\n", (unsigned long long)count, (unsigned long long)broken);
    return (report("sine", &sine, 1e-7, "") | report("cosine", &cosine, 1e-7, "") | sweep_turns()) || broken > 0;
}

static double ulps(double y, long double exact)
{
    int exponent;
    frexpl(exact, &exponent);
    return (double)ldexpl(fabsl((long double)y - exact), 53 - (exponent > -1021 ? exponent : -1021));
}

typedef struct {
    worst sine, cosine;
    unsigned long long count, broken;
} tally;

static void check_double(tally *t, double x)
{
    double s, c, s2, c2;
    noslip_sincos(x, &s, &c);
    noslip_sincos(-x, &s2, &c2);
    t->broken += !same(s2, -s) || !same(c2, c) || !(fabs(s) <= 1.0 && fabs(c) <= 1.0);
    note(&t->sine, ulps(s, sinl((long double)x)), x);
    note(&t->cosine, ulps(c, cosl((long double)x)), x);
    if (t->count++ % (1u << 25) == 0) {
        fprintf(stderr, "%llu\n", t->count - 1);
    }
}

/* in [0, 1) */
static double uniform(uint64_t *state)
{
    return (double)(trig_random(state) >> 11) / 9007199254740992.0;
}

static int sweep_double(unsigned long long n, uint64_t seed)
{
    tally t = {{0, 0}, {0, 0}, 0, 0};
    uint64_t state = seed * 2 + 1;
    long k;
    /* The three doubles around every multiple of pi/4: the hardest to reduce, and where the quadrant changes. */
    for (k = 0; k <= 1335088; k++) {
        const double x = (double)((long double)k * HALF_PI_L / 2);
        check_double(&t, x);
        check_double(&t, nextafter(x, -1.0));
        check_double(&t, nextafter(x, NOSLIP_ANGLE_MAX));
    }
    for (k = -1074; k <= 20; k++) {
        check_double(&t, ldexp(1.0, (int)k)); /* from the smallest subnormal to the end of the range */
    }
    while (t.count < n) {
        const double u = uniform(&state), v = uniform(&state);
        const long double distance = (long double)exp2(-60 * v);
        const long double multiple = (long double)floor(u * 667544) * HALF_PI_L;
        check_double(&t, u * NOSLIP_ANGLE_MAX);
        check_double(&t, u * 8.0);                       /* common angles */
        check_double(&t, (1.0 + u) * exp2(60 * v - 41)); /* 2^-41 ... 2^20, uniform in the logarithm */
        check_double(&t, (double)(multiple + distance)); /* near a multiple of pi/2, uniform in the logarithm */
        check_double(&t, (double)(multiple - distance));
    }
    printf("%llu doubles of each sign, %llu not odd/even or above 1\n", t.count, t.broken);
    return (report("sine", &t.sine, 1.0, "ulp") | report("cosine", &t.cosine, 1.0, "ulp")) || t.broken > 0;
}

typedef struct {
    worst single, absolute, relative;
    unsigned long long count, broken;
} atan2_tally;

/* The host's function depends on the sign of a zero; noslip_atan2 does not. */
static long double exact_atan2(double y, double x)
{
    return atan2l(y < 0 || y > 0 ? (long double)y : 0.0L, x < 0 || x > 0 ? (long double)x : 0.0L);
}

static void check_atan2(atan2_tally *t, double y, double x)
{
    const float y_f = (float)y, x_f = (float)x;
    const long double exact = exact_atan2(y, x);
    const double angle = noslip_atan2(y, x);
    t->broken += ((y < 0 || y > 0) && !same(noslip_atan2(-y, x), -angle)) || !(fabs(angle) <= 3.1415926535897932);
    note(&t->absolute, (double)fabsl((long double)angle - exact), y / x);
    if (fabsl(exact) > DBL_MIN) { /* below, the quotient itself is a rounded subnormal */
        note(&t->relative, ulps(angle, exact), y / x);
    }
    if (isfinite(y_f) && isfinite(x_f)) {
        const float angle_f = noslip_atan2_f(y_f, x_f);
        t->broken += ((y_f < 0 || y_f > 0) && !same_f(noslip_atan2_f(-y_f, x_f), -angle_f)) || !(fabsf(angle_f) <= 3.1415927f);
        note(&t->single, fabs((double)angle_f - (double)exact_atan2((double)y_f, (double)x_f)), y / x);
    }
    t->count++;
}

static int sweep_atan2(unsigned long long n, uint64_t seed)
{
    static const double special[] = {0, 4.9406564584124654e-324, DBL_MIN, 1e-45, 1e-20, 1, 1e30, 3e38, 1e300, DBL_MAX};
    const int specials = (int)(sizeof special / sizeof *special);
    atan2_tally t = {{0, 0}, {0, 0}, {0, 0}, 0, 0};
    uint64_t state = seed * 2 + 1;
    int i, k;
    for (i = 0; i < 4 * specials * specials; i++) {
        const double y = special[i / 4 % specials], x = special[i / 4 / specials];
        check_atan2(&t, i & 1 ? -y + 0.0 : y, i & 2 ? -x + 0.0 : x);
    }
    while (t.count < n) {
        const double u = uniform(&state), v = uniform(&state);
        const double turn = 4 * (double)HALF_PI_L * u, near = floor(16 * u) * (double)HALF_PI_L / 4 + exp2(-50 * v);
        const double size = exp2(40 * uniform(&state) - 20);
        for (k = 0; k < 2; k++) { /* any direction; near a multiple of pi/8, uniform in the logarithm */
            check_atan2(&t, size * sin(k ? near : turn), size * cos(k ? near : turn));
        }
        check_atan2(&t, size * (u - 0.5) * exp2(-60 * v), v - 0.5); /* near an axis */
    }
    printf("%llu directions, %llu not odd in y or beyond pi\n", t.count, t.broken);
    return (report("float", &t.single, 3e-7, "") | report("double", &t.absolute, 4e-16, "") |
            report("double", &t.relative, 2.5, "ulp")) || t.broken > 0;
}

/* A function of noslip_functions.h, its reference, its bounds in ulp, and the range of |x| that is swept. */
typedef struct {
    const char *name;
    float (*single)(float);
    double (*real)(double), (*exact)(double);
    long double (*exact_l)(long double);
    double limit_f, limit, low_f, high_f, low, high;
    int odd; /* 1: f(-x) = -f(x), -1: f(-x) = f(x), 0: neither, 2: not swept below zero */
} swept_function;

static const swept_function swept[] = {
    {"exp", noslip_exp_f, noslip_exp, exp, expl, 1, 1, 0, 87.3, 0, 708.3, 0},
    {"log", noslip_log_f, noslip_log, log, logl, 1, 1, 0, FLT_MAX, 0, DBL_MAX, 2},
    {"tanh", noslip_tanh_f, noslip_tanh, tanh, tanhl, 3, 3, FLT_MIN, 100, DBL_MIN, 800, 1},
    {"sinh", noslip_sinh_f, noslip_sinh, sinh, sinhl, 3, 3, FLT_MIN, 89.4, DBL_MIN, 710.4, 1},
    {"cosh", noslip_cosh_f, noslip_cosh, cosh, coshl, 3, 3, 0, 89.4, 0, 710.4, -1},
    {"atan", noslip_atan_f, noslip_atan, atan, atanl, 2.5, 2.5, FLT_MIN, FLT_MAX, DBL_MIN, DBL_MAX, 1},
    {"asin", noslip_asin_f, noslip_asin, asin, asinl, 3.5, 3.5, FLT_MIN, 1, DBL_MIN, 1, 1},
    {"acos", noslip_acos_f, noslip_acos, acos, acosl, 3.5, 3.5, 0, 1, 0, 1, 0},
};

/* Error in units of the last place of a float. */
static double ulps_f(float y, double exact)
{
    int exponent;
    frexp(exact, &exponent);
    return ldexp(fabs((double)y - exact), 24 - (exponent > -125 ? exponent : -125));
}

static void check_function_f(const swept_function *f, worst *w, unsigned long long *broken, float x)
{
    const float y = f->single(x), turned = f->odd == 2 ? 0 : f->single(-x);
    note(w, ulps_f(y, f->exact((double)x)), (double)x);
    if (f->odd == 0) {
        note(w, ulps_f(turned, f->exact(-(double)x)), -(double)x);
    }
    *broken += (f->odd == 1 && !same_f(turned, -y)) || (f->odd == -1 && !same_f(turned, y));
}

static void check_function(const swept_function *f, worst *w, unsigned long long *broken, double x)
{
    const double y = f->real(x), turned = f->odd == 2 ? 0 : f->real(-x);
    if (!(x >= f->low && x <= f->high)) {
        return;
    }
    note(w, ulps(y, f->exact_l((long double)x)), x);
    if (f->odd == 0) {
        note(w, ulps(turned, f->exact_l(-(long double)x)), -x);
    }
    *broken += (f->odd == 1 && !same(turned, -y)) || (f->odd == -1 && !same(turned, y));
}

/* Results outside a domain, and for infinities and NaN. */
static int sweep_edges(void)
{
    const float huge_f = HUGE_VALF;
    const double huge = HUGE_VAL;
    int wrong = 0, k;
    const double x[] = {-huge, -1e300, -2, -1, 0, 1, 2, 1e300, huge, huge - huge};
    for (k = 0; k < (int)(sizeof swept / sizeof *swept); k++) {
        int i;
        for (i = 0; i < (int)(sizeof x / sizeof *x); i++) {
            const double y = swept[k].real(x[i]), exact = swept[k].exact(x[i]);
            const float y_f = swept[k].single((float)x[i]);
            wrong += isnan(exact) ? !isnan(y) || !isnan(y_f) : !(fabs(y - exact) <= 1e-15 * fabs(exact)) && !same(y, exact);
        }
    }
    wrong += !same_f(noslip_log_f(0), -huge_f) || !same_f(noslip_exp_f(-huge_f), 0) || !same_f(noslip_exp_f(100.0f), huge_f);
    for (k = 0; k < 9; k++) { /* every pair of NaN, -1 and 1 */
        const double a = k % 3 == 0 ? huge - huge : k % 3 - 1.5, b = k / 3 == 0 ? huge - huge : k / 3 - 1.5;
        const int none = isnan(a) || isnan(b);
        const double found[] = {noslip_min(a, b), noslip_max(a, b), noslip_less(a, b)};
        const float a_f = (float)a, b_f = (float)b;
        const float found_f[] = {noslip_min_f(a_f, b_f), noslip_max_f(a_f, b_f), noslip_less_f(a_f, b_f)};
        const double right[] = {fmin(a, b), fmax(a, b), a < b};
        int i;
        for (i = 0; i < 3; i++) {
            wrong += none ? !isnan(found[i]) || !isnan(found_f[i])
                          : !same(found[i], right[i]) || !same_f(found_f[i], (float)right[i]);
        }
        wrong += isnan(a) ? !isnan(noslip_sign(a)) : !same(noslip_sign(a), a < 0 ? -1 : 1);
        wrong += isnan(a) ? !isnan(noslip_sign_f(a_f)) : !same_f(noslip_sign_f(a_f), a < 0 ? -1 : 1);
        wrong += isnan(a) ? !isnan(noslip_not(a)) || !isnan(noslip_if(a, 3))
                          : !same(noslip_not(a), 0) || !same(noslip_if(a, 3), 3);
        wrong += isnan(a) ? !isnan(noslip_not_f(a_f)) || !isnan(noslip_if_f(a_f, 3))
                          : !same_f(noslip_not_f(a_f), 0) || !same_f(noslip_if_f(a_f, 3), 3);
    }
    wrong += !same(noslip_not(0), 1) || !same(noslip_if(0, huge - huge), 0);
    wrong += !same_f(noslip_not_f(0), 1) || !same_f(noslip_if_f(0, huge_f - huge_f), 0);
    wrong += !same(noslip_sign(0), 0) || !same(noslip_less(1, 1), 0) || !isnan(noslip_pow(-1, 0.3)) ||
             !same(noslip_pow(0, 0.3), 0);
    wrong += !same_f(noslip_sign_f(0), 0) || !same_f(noslip_less_f(1, 1), 0) || !isnan(noslip_pow_f(-1, 0.3f)) ||
             !same_f(noslip_pow_f(0, 0.3f), 0);
    printf("%d wrong beyond domains and of what is not finite\n", wrong);
    return wrong > 0;
}

/* x^y relative to 1 + |y log x|, with which the error of the logarithm grows. */
static int sweep_power(unsigned long long n, uint64_t seed)
{
    worst single = {0, 0}, real = {0, 0};
    uint64_t state = seed * 2 + 1;
    while (n-- > 0) {
        const double x = exp2(40 * uniform(&state) - 20), y = 64 * uniform(&state) - 32, size = 1 + fabs(y * log(x));
        const float x_f = (float)x, y_f = (float)y;
        note(&real, size < 700 ? ulps(noslip_pow(x, y), powl((long double)x, (long double)y)) / size : 0, x);
        note(&single, size < 87 ? ulps_f(noslip_pow_f(x_f, y_f), pow((double)x_f, (double)y_f)) / size : 0, x);
    }
    return report("pow_f", &single, 2.5, "(1 + |y log x|) ulp") | report("pow", &real, 2.5, "(1 + |y log x|) ulp");
}

static int sweep_functions(uint32_t stride, unsigned long long n, uint64_t seed)
{
    int failed = sweep_edges() | sweep_power(n, seed), k;
    for (k = 0; k < (int)(sizeof swept / sizeof *swept); k++) {
        const swept_function *f = &swept[k];
        worst single = {0, 0}, real = {0, 0};
        unsigned long long broken = 0, i;
        uint64_t state = seed * 2 + 1, bits;
        noslip_bits_f x, last;
        char name[8];
        x.value = (float)f->low_f;
        last.value = (float)f->high_f;
        for (bits = x.bits; bits <= last.bits; bits += stride) {
            x.bits = (uint32_t)bits;
            check_function_f(f, &single, &broken, x.value);
        }
        for (i = 0; i < n; i++) {
            const double u = uniform(&state), v = uniform(&state), least = f->high < 2e3 ? -60 : -1074;
            const double most = f->high < 2e3 ? log2(f->high) : 1023;
            check_function(f, &real, &broken, f->high * u);
            check_function(f, &real, &broken, (1.0 + u) * exp2(floor(least + (most - least) * v))); /* in the logarithm */
            check_function(f, &real, &broken, 1.0 + (u - 0.5) * exp2(-50 * v));                      /* near 1 */
            check_function(f, &real, &broken, 2.0 * u);
        }
        snprintf(name, sizeof name, "%s_f", f->name);
        failed |= report(name, &single, f->limit_f, "ulp") | report(f->name, &real, f->limit, "ulp") | (broken > 0);
    }
    return failed;
}

static int sweep_sqrt(unsigned long long n, uint64_t seed)
{
    static const uint64_t special[] = {0, 1, 0x000fffffffffffffu, 0x0010000000000000u, 0x3fefffffffffffffu,
        0x7fefffffffffffffu, 0x7ff0000000000000u, 0x7ff8000000000000u};
    const size_t specials = sizeof special / sizeof *special;
    unsigned long long wrong = 0, i;
    uint64_t state = seed * 2 + 1;
    for (i = 0; i < n; i++) {
        noslip_bits x;
        noslip_bits_f x_f;
        double hard, soft, root;
        float hard_f, soft_f, root_f;
        x.bits = i < 2 * specials ? special[i / 2] | i << 63 : trig_random(&state); /* each special with either sign */
        x_f.bits = i < 2 * specials ? (uint32_t)(i << 31) | (uint32_t)(special[i / 2] >> 29 & 0x7fffffffu)
                                    : (uint32_t)(x.bits >> 13);
        if (i % 8 == 7) { /* squares and their neighbours */
            x.value = (double)(x.bits >> 37) * (double)(x.bits >> 37) + (double)((int)(x.bits % 3) - 1);
            x_f.value = (float)((double)(x_f.bits >> 20) * (double)(x_f.bits >> 20) + (double)((int)(x.bits % 3) - 1));
        } else if (i % 8 == 6 && i > 2 * specials) { /* subnormals */
            x.bits >>= 12 + (x.bits & 31);
            x_f.bits >>= 9 + (x_f.bits & 15);
        }
        root = sqrt(x.value);
        root_f = sqrtf(x_f.value);
        hard = noslip_sqrt(x.value);
        soft = noslip_soft_sqrt(x.value);
        hard_f = noslip_sqrt_f(x_f.value);
        soft_f = noslip_soft_sqrt_f(x_f.value);
        wrong += isnan(root) ? !(isnan(hard) && isnan(soft)) : !(same(hard, root) && same(soft, root));
        wrong += isnan(root_f) ? !(isnan(hard_f) && isnan(soft_f))
                               : !(same_f(hard_f, root_f) && same_f(soft_f, root_f));
    }
    /* every significand, with an even and an odd exponent: all cases of the integer routine for normal floats */
    for (i = 0x3f800000u; i < 0x40800000u; i++) {
        noslip_bits_f x_f;
        x_f.bits = (uint32_t)i;
        wrong += !same_f(noslip_soft_sqrt_f(x_f.value), sqrtf(x_f.value));
    }
    printf("%llu floats and doubles, %llu square roots wrong\n", n, wrong);
    return wrong > 0;
}

int main(int argc, char **argv)
{
    const char *mode = argc > 1 ? argv[1] : "";
    const unsigned long long a = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    const unsigned long long b = argc > 3 ? strtoull(argv[3], NULL, 10) : 0;
    const unsigned long long parts = argc > 4 ? strtoull(argv[4], NULL, 10) : 1;
    if (strcmp(mode, "float") == 0 && a > 0 && b < parts) {
        return sweep_float((uint32_t)a, (uint32_t)b, (uint32_t)parts);
    }
    if (strcmp(mode, "double") == 0) {
        return sweep_double(a, b);
    }
    if (strcmp(mode, "atan2") == 0) {
        return sweep_atan2(a, b);
    }
    if (strcmp(mode, "functions") == 0 && a > 0) {
        return sweep_functions((uint32_t)a, b, parts);
    }
    if (strcmp(mode, "sqrt") == 0) {
        return sweep_sqrt(a, b);
    }
    if (strcmp(mode, "digest") == 0) {
        printf("%016llx\n", (unsigned long long)trig_digest((uint32_t)a, b));
        return 0;
    }
    fprintf(stderr, "usage: trig_sweep float [stride [part parts]] | double N seed | atan2 N seed | "
                    "functions stride N seed | sqrt N seed | digest N seed\n");
    return 2;
}
