/*
 * noslip_approach.h - a reference that leads the vehicle to its path with bounded acceleration.
 *
 * Without it a law of path following wants the distance to be 0 at once, and asks for more than wheels can hold when it starts
 * beside the path. The generator leads the desired distance from where the vehicle is to 0: as fast as the acceleration permits, the
 * last part linear so that it does not chatter (Han's discrete time-optimal law with a linear zone, IEEE Trans. Industrial
 * Electronics 56(3), 2009); and the desired speed from the present speed. At the start, and after each correction of the pose:
 *
 *     noslip_approach_init(&approach, 0.5, 0.25, 0);
 *     noslip_approach_start(&approach, y[0], ydot[0], y[1]);      from the law's functions output and rate
 *
 * At each call of the controller, dt after the last:
 *
 *     noslip_approach_step(&approach, dt, 1.4, &wanted);
 *     reference.distance = wanted.distance;                       and the other fields, which have the same names
 *
 * On a composite path (noslip_path.h) the final speed is guide.speed, the reference of the law after
 *
 *     noslip_approach_within(&approach, guide.speed, guide.speed_rate, &wanted);
 *
 * and noslip_approach_start is called again where guide.L changes. For a point in the plane, or a heading, one generator leads each
 * output y: start with y - y_d and its rate, and add distance, its rate and acceleration to y_d and its derivatives. Of a point,
 * each coordinate may have the acceleration divided by sqrt(2).
 *
 * With a jerk in init the acceleration changes gradually. The distance then follows the fastest way that both bounds permit, from
 * its rate at the start (and no acceleration) to rest at 0; start finds it, by 64 halvings of an interval with four roots each. The
 * desired speed goes to the final one with both bounds; noslip_approach_within keeps the speed of a path, whose jerk is its own.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_APPROACH_H
#define NOSLIP_APPROACH_H

#include "noslip_controller.h"

#define NOSLIP_HALVINGS 64 /* of an interval of rates; the last ones do not change it any more */

#define NOSLIP_MODULE "noslip_approach.inc"
#include "noslip_scalars.inc"

#endif
