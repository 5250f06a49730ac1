/*
 * noslip_ekf.h - extended Kalman filter for the pose of a vehicle: the part that is the same for all robots.
 *
 * The filter of a robot (ROBOT_ekf.h) contains one of these as `filter`. Its tick, generated from the robot's kinematics, moves the
 * estimate by encoders and gyro; the functions below correct it by poses, positions, headings and ranges to landmarks, whenever
 * these come:
 *
 *     noslip_fix fix = {0};
 *     fix.kind = NOSLIP_FIX_POSITION;
 *     fix.x = 12.3; fix.y = 4.5; fix.sd = 0.05;
 *     fix.age = 0.12;                                  it was measured 0.12 s before the last tick
 *     noslip_ekf_correct(&ekf.filter, &fix);           NOSLIP_REJECTED: the gate did not let it pass
 *
 * The covariance is P = U D U' (Bierman, Factorization methods for discrete sequential estimation, 1977): D is positive, so that P
 * has no negative eigenvalue, in float too. The numbers of a measurement are used one after the other, all linearized at the
 * same estimate; their squared normalized innovations add up to that of the measurement (chi-square with as many degrees of
 * freedom), on which the gate decides for all of them.
 *
 * A late measurement is compared with the pose at its time: the present estimate minus what was driven since, from `past`. The
 * errors of that drive are in the estimate and do not get smaller by the measurement. Their variance is therefore added to the
 * covariance again, as a bound: to x and y that of both, with that of the heading over the way driven. What the gyro's bias and the
 * scales have to do with that drive is neglected: ages are meant to be parts of a second.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_EKF_H
#define NOSLIP_EKF_H

#include "noslip_factors.h"
#include "noslip_odometry.h"

#define NOSLIP_EKF_STATES 8   /* largest number of states: the pose and five more */
#define NOSLIP_EKF_FACTORS 36 /* entries of U and D for as many */

/* What is measured. */
typedef enum noslip_fix_kind {
    NOSLIP_FIX_POSE = 0,     /* position of the sensor, heading of the vehicle */
    NOSLIP_FIX_POSITION = 1, /* position of the sensor */
    NOSLIP_FIX_HEADING = 2,  /* heading of the vehicle */
    NOSLIP_FIX_RANGE = 3,    /* distance from the sensor to a landmark */
    NOSLIP_FIX_AS_INT = -0x7fffffff
} noslip_fix_kind;

#define NOSLIP_MODULE "noslip_ekf.inc"
#include "noslip_scalars.inc"

#endif
