/*
 * law_names.h - names of one law's C, for drivers that are written once and included for each law.
 *
 * ROBOT and LAW name the robot and the law (labmate, labmate_type_i), SUFFIX and REAL the scalar (nothing and double, or _f
 * and float). FOLLOWS is 1 where the law has a second step, follow, that a path tells the foot, else 0. Every struct of a law
 * but the law itself and options is REALs only, so it can be filled like an array.
 */
#ifndef LAW_NAMES_H
#define LAW_NAMES_H

#include <string.h>

#include "trig_digest.h"

#define GLUE_(a, b) a##b
#define GLUE(a, b) GLUE_(a, b)
#define OF_LAW(name) GLUE(GLUE(LAW, name), SUFFIX)
#define OF_ROBOT(name) GLUE(GLUE(ROBOT, name), SUFFIX)
#define DRIVER(name) GLUE(name, OF_LAW())
#define FOOT GLUE(noslip_foot, SUFFIX)
#define COUNT(array) ((int)(sizeof(array) / sizeof(*(array))))
#define REALS(object) ((REAL *)(void *)&(object)), (int)(sizeof(object) / sizeof(REAL))

/* The law's steps: number 0 is step, number 1, where there is one, follow. */
#define STEPS (1 + FOLLOWS)
#define STEP_0(number, self, foot, state, reference, tau) OF_LAW(_step)(self, state, reference, tau)
#define STEP_1(number, self, foot, state, reference, tau) \
    ((number) > 0 ? OF_LAW(_follow)(self, foot, state, reference, tau) : OF_LAW(_step)(self, state, reference, tau))
#define STEP(number, self, foot, state, reference, tau) \
    GLUE(STEP_, FOLLOWS)(number, self, foot, state, reference, tau)

/* in [-1, 1), the same in float and double */
static inline double random_unit(uint64_t *random)
{
    return (double)((int32_t)(trig_random(random) >> 40) - 8388608) / 8388608.0;
}

static inline uint64_t digest_bytes(uint64_t hash, const void *bytes, size_t size)
{
    const unsigned char *next = bytes;
    while (size-- > 0) {
        hash = (hash ^ *next++) * 0x100000001b3u;
    }
    return hash;
}

#endif
