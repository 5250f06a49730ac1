/*
 * trailers.h - reduced mass matrix and bias of a tractor with trailers hitched on the axles, as a person writes them for
 * speed: one loop over the trailers. For double and, with the suffix _f, for float. No guards.
 *
 * Every trailer moves with the tractor's forward speed v alone: forward with g v, where g is the product of the cosines of
 * the angles between the bodies so far, and turning with s g v / l, s the sine of the last angle and g that of the body
 * before. What v-dot does not explain of these accelerations is a, along the trailer, and b / l, about its axle; then
 *     mass of v     m_t + sum of m g^2 + J (s g / l)^2            J = I + m d^2, about the axle
 *     bias of v     -m d omega^2 (tractor) + sum of m g a + J (s g / l) (b / l)
 * A state is an array: x, y, phi, the wheels' angles, phi_1 .. phi_n, the wheels' rates.
 */
#ifndef TRAILERS_H
#define TRAILERS_H

#include "noslip_real.h"
#include "noslip_trig.h"

#define MOST_TRAILERS 32

#define REAL double
#define NAME(name) name
#include "trailers.inc"
#undef REAL
#undef NAME

#define REAL float
#define NAME(name) name##_f
#include "trailers.inc"
#undef REAL
#undef NAME

#endif
