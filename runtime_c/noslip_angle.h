/*
 * noslip_angle.h - the short way round: a wanted angle, whole turns put aside so that it is near the actual one.
 *
 * An outer loop forms wanted minus actual. Where an output is a heading (Types II and III) and one of the two has been counted
 * over more turns than the other, that difference sends the robot round and round. Before each step:
 *
 *     noslip_nearest_angle(wanted_heading, state.phi, &reference.heading);
 *
 * The function exists for double and, with the suffix _f, for float; both come from noslip_angle.inc.
 */
#ifndef NOSLIP_ANGLE_H
#define NOSLIP_ANGLE_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"
#include "noslip_trig.h"

#define NOSLIP_REAL double
#define NOSLIP_NAME(name) name
#include "noslip_angle.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#define NOSLIP_REAL float
#define NOSLIP_NAME(name) name##_f
#include "noslip_angle.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#endif
