/*
 * noslip_grip.h - inputs with which the wheels keep rolling.
 *
 * The force of the ground at each contact is affine in the inputs; rolling holds while its size is at most mu times the load there,
 * a convex cone. Along a line of inputs each cone is an interval, from one square root. Used by the step of a law with
 * options.on_limit = NOSLIP_GRIP:
 *
 *     labmate_options options = {.on_limit = NOSLIP_GRIP, .friction = {.mu = 0.6, .margin = 0.1, .height = 0.2}};
 *
 * The step returns NOSLIP_GRIP_LIMITED if it changed the inputs so that the wheels roll, and NOSLIP_WILL_SLIP if no inputs on the way
 * to coasting keep them rolling. What is given up first: the desired speed, then everything in favour of coasting.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_GRIP_H
#define NOSLIP_GRIP_H

#include "noslip_controller.h"

#define NOSLIP_GRAVITY 9.81 /* m/s^2 */
#define NOSLIP_EARNED_FIRST 0.6 /* part of mu that is believed at first */
#define NOSLIP_EARNED_RISE 0.5  /* 1/s: part of mu by which it rises */
#define NOSLIP_EARNED_AFTER 0.9 /* part that is believed of the friction that a wheel showed */
#define NOSLIP_EARNED_ERROR 0.5 /* of accelerations: (1 + 0.2) / (1 - 0.2) - 1, of torques and masses that are off by 20 % */
#define NOSLIP_EARNED_ASKED 4   /* a wheel shows friction where more than 1/4 of mu load is asked of it */

#define NOSLIP_MODULE "noslip_grip.inc"
#include "noslip_scalars.inc"

#endif
