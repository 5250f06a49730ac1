/*
 * noslip_course.h - a smooth curve for laws with a dynamic extension: a point of it with six derivatives.
 *
 * An output of relative degree k follows a reference without an error only if k - 1 of its derivatives are continuous. The
 * middle of a car's rear axle has k = 4: it cannot follow lines and arcs, where the steering angle would have to jump, nor
 * clothoids, where its rate would. A course is given by its curvature where parts begin and end; before the first and after the
 * last it stays. With a rounding the parts are lines, arcs and clothoids, and the rate of the curvature changes smoothly over that
 * length where they meet; without, the curvature changes smoothly over the whole of each part. The beginning is not rounded: if a
 * vehicle may be behind it, let a course with a rounding begin with a line or an arc, else the rate jumps there.
 *
 *     static const float lengths[] = {2, 4, 5}, curvatures[] = {0, 0, 0.2f, 0.2f};
 *     static noslip_stretch_f stretches[NOSLIP_COURSE_ROOM(3)];
 *     const noslip_course_options_f options = {.lengths = lengths, .curvatures = curvatures, .count = 3, .rounding = 0.2f};
 *     status = noslip_course_init_f(&course, stretches, NOSLIP_COURSE_ROOM(3), &options);
 *
 * At each call, with the position of the output and the length along the course of the call before:
 *
 *     status = noslip_course_nearest_f(&course, x, y, &length);      or length += speed * dt: in time
 *     status = noslip_course_at_f(&course, length, speed, &point);
 *     reference.x_l = point.x[0];                                    reference.x_l_rate = point.x[1]; and so on
 *
 * A course may have cusps, where lengths change their sign: the vehicle stops there and drives back. A tracker holds the piece
 * that is followed. For a law of Type IV along a course, with the pose of the vehicle's point and its forward speed:
 *
 *     const noslip_course_tracker_options_f options = {.speed = 0.5f, .deceleration = 0.3f, .L = {-0.3f, -0.3f}, .ahead = 0.3f};
 *     status = noslip_course_tracker_init_f(&tracker, &course, &options);
 *     status = noslip_course_tracker_update_f(&tracker, x, y, heading, forward_speed, &guide);
 *     config.x_s = guide.x; config.curvature = guide.curvature[0]; and so on; reference.speed = guide.speed
 *
 * A piece ends where P_l, or with NOSLIP_STOP_AXLE the axle, has reached its end and the vehicle stands, |forward_speed| <= creep. It
 * is not followed again, wherever the vehicle is moved to. Beyond its end its last curvature stays. Before a stop the desired speed
 * is sqrt(2 deceleration left), at most `speed` and at least `creep`; from the stop on it is 0. At the end the status is
 * NOSLIP_ARRIVED.
 *
 * A call computes two sines and cosines on lines and arcs, 9 on clothoids, 25 elsewhere, and 8 more for each radian that a stretch
 * turns; noslip_course_nearest as many for each of its steps, two or three if the vehicle goes on as before.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_COURSE_H
#define NOSLIP_COURSE_H

#include "noslip_path.h"
#include "noslip_reversing.h"

#define NOSLIP_COURSE_ORDER 6                       /* of the highest derivative */
#define NOSLIP_COURSE_BENDS (NOSLIP_COURSE_ORDER - 1) /* curvature and derivatives of it */
#define NOSLIP_COURSE_TERMS 10                      /* of the polynomial of a curvature */
#define NOSLIP_COURSE_TURN 16                       /* rad: that a stretch may turn */
#define NOSLIP_COURSE_STEPS 20                      /* of Newton's method, at most */
#define NOSLIP_COURSE_BACK 3.141592653589793         /* rad: by which the direction of travel turns at a cusp */
#define NOSLIP_COURSE_FLATTEST 0.1                  /* how near a point may be to the centre of curvature, in radii */
#define NOSLIP_COURSE_ROOM(count) (2 * (count) + 1) /* stretches for so many parts */

#define NOSLIP_MODULE "noslip_course.inc"
#include "noslip_scalars.inc"

#endif
