/*
 * noslip_profile.h - the fastest speed along a composite path for given accelerations.
 *
 * noslip_path.h keeps one speed up to the next stop, also where an arc begins. A profile limits it: the lateral acceleration on an
 * arc, v^2 / radius of the middle of the axle, and the acceleration along the path are together within an ellipse, as the force of
 * a wheel is within a circle of friction:
 *
 *     (lateral / limits.lateral)^2 + (forward / limits.acceleration)^2 <= 1, and likewise with limits.deceleration
 *
 * At a join, where the curvature jumps, the vehicle also has to begin to turn: limits.angular, rad/s^2, bounds the change of its
 * yaw rate there. It is the fastest one within these limits: a pass from the end to the start brakes in time, a pass from the start to the end
 * accelerates, each exact on lines and arcs (a straight line, or a sine, of v^2 over the way). The lateral acceleration is that of
 * a vehicle that turns with the curvature of the path; after a join it does so within a way of about the lookahead.
 *
 *     static float squares[COUNT];
 *     noslip_path_init_f(&path, segments, COUNT, &options, NULL);          options.speed: the largest anywhere
 *     noslip_profile_init_f(&profile, segments, COUNT, &options, &limits, squares);
 *
 * At each call, after noslip_path_step:
 *
 *     noslip_profile_speed_f(&profile, &path.guide, forward_speed, &reference.speed, &reference.speed_rate);
 *
 * The speed rises from rest with the vehicle at the beginning of the path, or limits.behind before it. Give how far the vehicle
 * starts behind, plus how far beside the path: it would creep there, and turn across the path. On a closed path the profile is that
 * of the laps after the first one; begin the first one with noslip_approach.h. noslip_profile_speed computes at most two sines, two
 * arctangents and five square roots.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_PROFILE_H
#define NOSLIP_PROFILE_H

#include "noslip_path.h"

#define NOSLIP_MODULE "noslip_profile.inc"
#include "noslip_scalars.inc"

#endif
