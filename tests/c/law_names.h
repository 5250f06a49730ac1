/*
 * law_names.h - C names of a law, for drivers that are included once for each law.
 *
 * ROBOT and LAW name the robot and the law (labmate, labmate_type_i), SUFFIX and REAL the scalar (nothing and double, or _f
 * and float). FOLLOWS is 1 if the law has the step function follow, which takes the foot on a path, else 0. Every struct of
 * a law except the law itself and options consists of REALs, so that it can be filled like an array.
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
#define REALS(object) ((REAL *)(void *)&(object)), NUMBER_OF_REALS(object)

/* Number of REALs in an object, and their copy to a lane of an array of n lanes, as batch laws take them. */
#define NUMBER_OF_REALS(object) ((int)(sizeof(object) / sizeof(REAL)))
#define TO_LANE(object, array, n, lane) \
    do { \
        int entry; \
        for (entry = 0; entry < NUMBER_OF_REALS(object); entry++) { \
            (array)[entry * (n) + (lane)] = ((REAL *)(void *)&(object))[entry]; \
        } \
    } while (0)

/* The step functions of the law: 0 is step, 1 is follow, if it exists. */
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
