/*
 * lanes.h - robots that are simulated together, one in each lane of vectors; lanes.inc is compiled for several sizes of vectors.
 *
 * An entry is a vector: number k of an array, of the robot in lane i, is at [k * width + i].
 */
#ifndef LANES_H
#define LANES_H

#include "batch_law.h"

#define LANES_MOST 8 /* lanes of the longest vectors */

#define BATCH_STAGES 7 /* of the integrator, the method of order 6 of Butcher, On Runge-Kutta processes of high order, 1964 */
#define BATCH_SHARES { \
    {0}, \
    {1.0 / 3}, \
    {0, 2.0 / 3}, \
    {1.0 / 12, 1.0 / 3, -1.0 / 12}, \
    {-1.0 / 16, 9.0 / 8, -3.0 / 16, -3.0 / 8}, \
    {0, 9.0 / 8, -3.0 / 8, -3.0 / 4, 1.0 / 2}, \
    {9.0 / 44, -9.0 / 11, 63.0 / 44, 18.0 / 11, 0, -16.0 / 11}, \
    {11.0 / 120, 0, 27.0 / 40, 27.0 / 40, -4.0 / 15, -4.0 / 15, 11.0 / 120}, \
}

#if BATCH_LANES
typedef struct lanes_group {
    double plant[LANES_MOST * BATCH_PLANT_CONSTANTS];
    double believed[LANES_MOST * BATCH_LAW_CONSTANTS]; /* of the law in double */
    double truth[LANES_MOST * BATCH_LAW_CONSTANTS];    /* the same with the true parameters */
    double sign[LANES_MOST];                           /* of det Phi at the start */
    double omega[LANES_MOST];                          /* 1/s: of the drives, and their largest acceleration */
    double most_acceleration[LANES_MOST * BATCH_DOF];
    double offset[LANES_MOST * BATCH_REFERENCE];       /* reference: offset + slope t */
    double slope[LANES_MOST * BATCH_REFERENCE];
    double x[LANES_MOST * BATCH_STATE];
    double sine[LANES_MOST * BATCH_STATE];             /* of x, where `turned` */
    double cosine[LANES_MOST * BATCH_STATE];
    double given[LANES_MOST * BATCH_GIVEN];            /* what the drives are given; for torques, the inputs */
    double apart[LANES_MOST];                          /* largest difference of the states by steps of the whole and half length */
    double error[LANES_MOST * BATCH_ROWS];             /* of the true outputs */
    double fine[LANES_MOST];                           /* 1: the lane has what was asked for; 0: the scalar code must compute it */
    int turned;
} __attribute__((aligned(64))) lanes_group;

#else
typedef struct lanes_group lanes_group;
#endif

/* The code for vectors of a size. */
typedef struct lanes_kit {
    const char *name;
    int width;
    /* Integrates x for `duration` seconds in `count` steps; if it `weighs`, also with half the steps, which gives `apart`. */
    void (*hold)(lanes_group *group, double duration, int count, int weighs);
    void (*step)(lanes_group *group, double t); /* the inputs at a time, by the law without dynamic extension in double */
    void (*look)(lanes_group *group, double t); /* the errors at a time */
} lanes_kit;

extern const lanes_kit lanes_plain, lanes_avx2, lanes_avx512;

#endif
