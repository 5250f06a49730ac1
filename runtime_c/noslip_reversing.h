/*
 * noslip_reversing.h - is the sign of the speed the one that a path following law needs?
 *
 * The heading of a vehicle whose point P_l follows a path goes like exp(-v t / l) with v the forward speed and l = L + d the
 * distance of P_l ahead of the axle: where the two have opposite signs it diverges from the path. Forward wants P_l ahead of
 * the axle, backward behind it.
 *
 * The function exists for double and, with the suffix _f, for float; both come from noslip_reversing.inc.
 */
#ifndef NOSLIP_REVERSING_H
#define NOSLIP_REVERSING_H

#include <stddef.h>

#include "noslip_real.h"
#include "noslip_status.h"

#define NOSLIP_REAL double
#define NOSLIP_NAME(name) name
#include "noslip_reversing.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#define NOSLIP_REAL float
#define NOSLIP_NAME(name) name##_f
#include "noslip_reversing.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#endif
