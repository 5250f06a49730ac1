/*
 * noslip_odometry.h - where a vehicle is, reckoned from how far its wheels turned; corrections of that; wheel encoders.
 *
 * For any vehicle in the plane that does not slip, whose forward speed and yaw rate are fixed combinations of two wheel rates.
 *
 *     noslip_odometry_options options = {0};
 *     noslip_odometry_differential(&options, r, b, d);   two wheels on one axle, the pose is that of a point d ahead of it
 *     noslip_odometry_init(&self, &options, &start);
 *     noslip_odometry_move(&self, angle, dt, &pose);     at each sample
 *
 * self.pose is the pose told last, self.direction cosine and sine of its heading, for noslip_path_step.
 *
 * Exact where both wheels turned evenly between two samples: the axle's middle went along an arc, its chord is the way times
 * sin(turn / 2) / (turn / 2), in the direction of the heading in between. Sums are compensated (Kahan), so that float does not lose small
 * steps. What stays is the rounding of each step: a direction is good to 1e-7 in float, and to heading * 6e-8.
 *
 * Each function exists for double and, with the suffix _f, for float; both come from noslip_odometry.inc.
 */
#ifndef NOSLIP_ODOMETRY_H
#define NOSLIP_ODOMETRY_H

#include "noslip_controller.h"

/* How a correction is let in. */
enum {
    NOSLIP_RESET = 0,   /* at once: the pose jumps */
    NOSLIP_BUMPLESS = 1 /* bit by bit, over the time `release` */
};

#define NOSLIP_REAL double
#define NOSLIP_NAME(name) name
#include "noslip_odometry.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#define NOSLIP_REAL float
#define NOSLIP_NAME(name) name##_f
#include "noslip_odometry.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#endif
