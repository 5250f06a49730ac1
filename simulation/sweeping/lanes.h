/*
 * lanes.h - robots that are simulated together, one in each lane of vectors; lanes.inc is compiled for several sizes of vectors.
 *
 * An entry is a vector: number k of an array, of the robot in lane i, is at [k * width + i]. Arrays are aligned, since each has as
 * many bytes as a multiple of the longest vector, and what is not an array comes last. Groups take their steps in turn, stage by
 * stage: an operation of one waits for the operation before it, and meanwhile the processor computes those of another.
 */
#ifndef LANES_H
#define LANES_H

#include "batch_law.h"

#define LANES_MOST 8     /* lanes of the longest vectors */
#define LANES_GROUPS 2   /* groups that are simulated together */
#define LANES_WAITING 64 /* calls whose commands wait for their delay */

#define BATCH_STAGES 7 /* of the integrator, most */

/* A method of Runge and Kutta: before each stage after the first, and at the end of a step, the shares of the slopes so far. */
typedef struct batch_method {
    int order, stages;
    double share[BATCH_STAGES + 1][BATCH_STAGES];
} batch_method;

/* That of order 4 of Kutta (1901), and that of order 6 of Butcher, On Runge-Kutta processes of high order, 1964. */
static const batch_method batch_methods[2] = {
    {4, 4, {{0}, {1.0 / 2}, {0, 1.0 / 2}, {0, 0, 1}, {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}}},
    {6, 7, {
        {0},
        {1.0 / 3},
        {0, 2.0 / 3},
        {1.0 / 12, 1.0 / 3, -1.0 / 12},
        {-1.0 / 16, 9.0 / 8, -3.0 / 16, -3.0 / 8},
        {0, 9.0 / 8, -3.0 / 8, -3.0 / 4, 1.0 / 2},
        {9.0 / 44, -9.0 / 11, 63.0 / 44, 18.0 / 11, 0, -16.0 / 11},
        {11.0 / 120, 0, 27.0 / 40, 27.0 / 40, -4.0 / 15, -4.0 / 15, 11.0 / 120},
    }},
};

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
    double first[LANES_MOST * BATCH_GIVEN];            /* what the drives are given before the first call, and by the last calls */
    double ring[LANES_WAITING][LANES_MOST * BATCH_GIVEN];
    double total[LANES_MOST];                          /* estimated error of the integrator so far */
    double final[LANES_MOST * BATCH_ROWS];             /* outcomes, as in batch.h */
    double peak[LANES_MOST * BATCH_ROWS];
    double settling[LANES_MOST * BATCH_ROWS];
    double effort[LANES_MOST * BATCH_INPUTS];
    double band[LANES_MOST * BATCH_ROWS];
    double mu[LANES_MOST], share[LANES_MOST], height[LANES_MOST], use[LANES_MOST]; /* of the floor, and its largest use */
    double weight[LANES_MOST], raised[LANES_MOST];     /* of the floor as the law knows it, see noslip_grip */
    double going[LANES_MOST];                          /* 1: the run has not ended */
    double fine[LANES_MOST];                           /* 1: the lane has what was asked for; 0: the scalar code must compute it */
    int turned;                                        /* 1: sine and cosine are those of x */
} __attribute__((aligned(64))) lanes_group;

#else
typedef struct lanes_group lanes_group;
#endif

/* The code for vectors of a size, for LANES_GROUPS groups. Commands are those of number `call` of the ring, or the first if it is
 * negative. The functions return 1 if each lane that is going is fine. */
typedef struct lanes_kit {
    const char *name;
    int width;
    /* Integrates x for `duration` seconds in `count` steps of a method; if `weight` is not 0, also with half the steps, and adds `weight` times
     * the largest difference to the error. Lanes that are not fine stay where they are; those of runs that have ended need not. */
    int (*hold)(lanes_group *groups, int call, double duration, int method, int count, double weight);
    /* Where nothing else belongs to the loop: the inputs by the law, the outcomes at an output time, and those of inputs that act;
     * `gripped`: the inputs are limited by friction; `grounded`: the floor of a run is known. */
    int (*step)(lanes_group *groups, double t, int call, int gripped);
    int (*look)(lanes_group *groups, double t, int call, int grounded);
    void (*push)(lanes_group *groups, int call);
} lanes_kit;

extern const lanes_kit lanes_plain, lanes_avx2, lanes_avx512;

#endif
