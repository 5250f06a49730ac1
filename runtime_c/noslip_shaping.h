/*
 * noslip_shaping.h - inputs with which the wheels keep rolling, for robots with more than two inputs.
 *
 * Where there are more inputs than n - m, many inputs give the same motion, and their difference shapes the forces of the ground.
 * A step with options.on_limit = NOSLIP_GRIP first uses this freedom, then gives up the desired speed, then goes towards coasting;
 * see noslip_grip.h.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_SHAPING_H
#define NOSLIP_SHAPING_H

#include "noslip_grip.h"
#include "noslip_solve.h"

#define NOSLIP_MODULE "noslip_shaping.inc"
#include "noslip_scalars.inc"

#endif
