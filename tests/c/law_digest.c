/*
 * law_digest.c - digests of the bits of all results of the LABMATE's laws and batch laws, dead reckoning, filter and paths, to compare
 * between targets.
 *
 * It needs only memcpy and memset, which compilers call themselves. With a C library it has its own main: law_digest STATES
 * DOUBLES.
 */
#include "labmate_ekf.h"
#include "labmate_ekf_f.h"
#include "noslip_adaptation.h"
#include "noslip_balance.h"
#include "noslip_disturbance.h"
#include "lanes/labmate_type_i_steps.h"
#include "lanes/labmate_type_i_steps_f.h"
#include "lanes/labmate_type_ii_steps.h"
#include "lanes/labmate_type_ii_steps_f.h"
#include "lanes/labmate_type_iii_steps.h"
#include "lanes/labmate_type_iii_steps_f.h"
#include "lanes/labmate_type_iv_circle_steps.h"
#include "lanes/labmate_type_iv_circle_steps_f.h"
#include "lanes/labmate_type_iv_ellipse_steps.h"
#include "lanes/labmate_type_iv_ellipse_steps_f.h"
#include "lanes/labmate_type_iv_line_steps.h"
#include "lanes/labmate_type_iv_line_steps_f.h"
#include "lanes/labmate_type_iv_segment_steps.h"
#include "lanes/labmate_type_iv_segment_steps_f.h"
#include "law_digest_line.h"
#include "law_names.h"
#include "noslip_odometry.h"
#include "noslip_path.h"

#define STATES_A_ROBOT 50        /* with the same parameters */
#define STATES_A_LOOK_AT_PARTS 4 /* one of these also calls the functions of single quantities */

typedef struct {
    uint64_t hash;
    uint32_t good; /* states at which every step succeeded */
} law_bits;

static uint64_t bits_of_status(uint64_t hash, int status)
{
    return trig_fnv(hash, (uint64_t)status);
}

/* 0.5 to 8 */
static double positive_value(uint64_t *random)
{
    const double scale = (double)(1u << (trig_random(random) >> 62));
    return scale * (1.0 - 0.5 * noslip_abs(random_unit(random)));
}

/* Mostly between -4 and 4; some are zero, small, beyond the range of angles, or overflow in float. */
static double any_value(uint64_t *random)
{
    const uint32_t kind = (uint32_t)(trig_random(random) >> 54); /* 0 to 1023 */
    const double scale = kind == 0    ? 1267650600228229401496703205376.0 /* 2^100 */
                         : kind < 32  ? 16384.0
                         : kind < 64  ? 0.0
                         : kind < 128 ? 1.0 / 1048576.0
                                      : 4.0;
    return scale * random_unit(random);
}

#define ROBOT labmate
#define FOLLOWS 0
#define LAW labmate_type_i
#include "law_bits.inc"
#undef LAW
#define LAW labmate_type_ii
#include "law_bits.inc"
#undef LAW
#define LAW labmate_type_iii
#include "law_bits.inc"
#undef LAW
#define LAW labmate_type_iv_circle
#include "law_bits.inc"
#undef LAW
#define LAW labmate_type_iv_ellipse
#include "law_bits.inc"
#undef LAW
#define LAW labmate_type_iv_line
#include "law_bits.inc"
#undef LAW
#undef FOLLOWS
#define FOLLOWS 1
#define LAW labmate_type_iv_segment
#include "law_bits.inc"
#undef LAW
#include "noslip_course.h"
#include "route_bits.inc"

/* The last: a vehicle on a path, its filter, its masses, a course, a feedback about rest, disturbances. */
typedef void law_runner(uint32_t n, law_bits *bits);
static law_runner *const in_float[] = {bits_labmate_type_i_f,          bits_labmate_type_ii_f,
                                       bits_labmate_type_iii_f,        bits_labmate_type_iv_circle_f,
                                       bits_labmate_type_iv_ellipse_f, bits_labmate_type_iv_line_f,
                                       bits_labmate_type_iv_segment_f, bits_route_f,
                                       bits_ekf_f,                     bits_adaptation_f,
                                       bits_course_f,                  bits_balance_f,
                                       bits_disturbance_f};
static law_runner *const in_double[] = {bits_labmate_type_i,          bits_labmate_type_ii,
                                        bits_labmate_type_iii,        bits_labmate_type_iv_circle,
                                        bits_labmate_type_iv_ellipse, bits_labmate_type_iv_line,
                                        bits_labmate_type_iv_segment, bits_route,
                                        bits_ekf,                     bits_adaptation,
                                        bits_course,                  bits_balance,
                                        bits_disturbance};
#define LAWS ((int)(sizeof in_float / sizeof in_float[0]))
typedef char as_many_in_double[sizeof in_float == sizeof in_double ? 1 : -1];

static char *write_hex(char *text, uint64_t value, int digits)
{
    while (digits-- > 0) {
        *text++ = "0123456789abcdef"[value >> 4 * digits & 15];
    }
    *text++ = ' ';
    return text;
}

static char *write_bits(char *text, law_runner *const *laws, uint32_t n)
{
    law_bits bits = {0xcbf29ce484222325u, 0};
    int i;
    for (i = 0; i < LAWS; i++) {
        laws[i](n, &bits);
    }
    return write_hex(write_hex(text, bits.hash, 16), bits.good, 8);
}

/*
 * Whether sums of doubles are rounded correctly. On ARM without an FPU for double they are not: if exponents differ by 33 and the
 * difference loses its leading bit, libgcc (12) has discarded the bit that determines the rounding. Laws in double can then differ
 * from other targets, about once in a million sums.
 */
static int sums_are_right(void)
{
    static const volatile double large = 8589934592.0, small = 0x1.c2f5b6d79cp+0;
    return (large - small) - 8589934590.0 > 0x1.e852p-3; /* it is 0x1.e8528p-3 */
}

const char *law_digest(uint32_t n, uint32_t n_double)
{
    static char text[80];
    char *end = write_bits(write_bits(text, in_float, n), in_double, n_double);
    end = write_hex(end, trig_digest(n, 5), 16);
    end = write_hex(end, (uint64_t)sums_are_right(), 1);
    end[-1] = '\n';
    *end = '\0';
    return text;
}

#if __STDC_HOSTED__
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    return argc != 3 ||
           fputs(law_digest((uint32_t)strtoul(argv[1], NULL, 10), (uint32_t)strtoul(argv[2], NULL, 10)), stdout) < 0;
}
#endif
