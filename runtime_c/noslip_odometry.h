/*
 * noslip_odometry.h - dead reckoning of the pose from wheel rotation; pose corrections; wheel encoders.
 *
 * For any planar vehicle that rolls without slipping and whose forward speed and yaw rate are fixed combinations of two wheel
 * rates.
 *
 *     noslip_odometry_options options = {0};
 *     noslip_odometry_differential(&options, r, b, d);   two wheels on one axle; the pose is that of a point d ahead of it
 *     noslip_odometry_init(&self, &options, &start);
 *     noslip_odometry_move(&self, angle, dt, &pose);     at each sample
 *     noslip_odometry_unwind(&self);                     before a move, for instance where |pose.heading| > 4 rad
 *
 * The heading is not wrapped. A vehicle that drives many turns must subtract whole turns with unwind. Otherwise a move beyond
 * NOSLIP_ANGLE_MAX (8192 rad in float) is rejected with NOSLIP_RANGE, and before that the resolution of the heading decreases.
 *
 * self.pose is the last pose returned; self.direction contains cosine and sine of its heading, for noslip_path_step.
 *
 * The result is exact if both wheels turn at constant rates between two samples: the middle of the axle then moves along an arc
 * whose chord is the distance times sin(turn / 2) / (turn / 2), in the direction of the mean heading. Sums are compensated (Kahan),
 * so that float does not lose small steps. The rounding of each step remains: a direction is accurate to 1e-7 in float, plus
 * heading * 6e-8.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_ODOMETRY_H
#define NOSLIP_ODOMETRY_H

#include "noslip_controller.h"

/* How a correction is applied. */
typedef enum noslip_correction {
    NOSLIP_RESET = 0,    /* at once: the pose jumps */
    NOSLIP_BUMPLESS = 1, /* gradually, over the time `release` */
    NOSLIP_CORRECTION_AS_INT = -0x7fffffff
} noslip_correction;

#define NOSLIP_MODULE "noslip_odometry.inc"
#include "noslip_scalars.inc"

#endif
