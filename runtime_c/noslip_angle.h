/*
 * noslip_angle.h - a desired angle, shifted by whole turns to be nearest to the actual one.
 *
 * The outer loop computes desired minus actual value. If an output is a heading (Types II and III) and the two differ by whole
 * turns, the robot would turn that many times. To avoid this, call before each step:
 *
 *     noslip_nearest_angle(desired_heading, state.phi, &reference.heading);
 *
 * The function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_ANGLE_H
#define NOSLIP_ANGLE_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"
#include "noslip_trig.h"

#define NOSLIP_MODULE "noslip_angle.inc"
#include "noslip_scalars.inc"

#endif
