/*
 * noslip_reversing.h - checks that the speed has the sign that path following requires.
 *
 * If P_l follows a path, the heading error of the vehicle varies as exp(-v t / l), with forward speed v and l = L + d, the
 * distance of P_l ahead of the axle. If the two have opposite signs, the heading diverges from the path. P_l must be ahead of the
 * axle when driving forward and behind it in reverse.
 *
 * The function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_REVERSING_H
#define NOSLIP_REVERSING_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"

#define NOSLIP_MODULE "noslip_reversing.inc"
#include "noslip_scalars.inc"

#endif
