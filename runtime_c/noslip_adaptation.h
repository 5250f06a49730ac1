/*
 * noslip_adaptation.h - parameters that change, such as a payload, by recursive least squares.
 *
 * The reduced dynamics (10), S'MS nudot + bias = S'E tau, are affine in masses and inertias. Each call gives one such equation
 * for each quasi-velocity. They are smoothed, both sides alike, and the parameters minimize the squares of their errors, of which
 * the old ones are forgotten:
 *
 *     status = labmate_adaptation_init(&adaptation, &config);
 *     status = labmate_adaptation_step(&adaptation, &state, tau, dt, &params);   at each call; tau: the inputs since the last
 *     status = labmate_follower_update(&follower, &params, &gains, &limits);     now and then, or init and update of a law
 *
 * An equation that holds within the dead zone teaches nothing, and nothing is then forgotten: neither is what a motion
 * does not show. The estimates stay within their bounds, and what is in use follows them slowly.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_ADAPTATION_H
#define NOSLIP_ADAPTATION_H

#include "noslip_controller.h"
#include "noslip_factors.h"

#define NOSLIP_ADAPTED 4 /* parameters at most */
#define NOSLIP_ADAPTED_ROWS 4 /* equations at most: quasi-velocities */
#define NOSLIP_ADAPTED_FACTORS (NOSLIP_ADAPTED * (NOSLIP_ADAPTED + 1) / 2)

#define NOSLIP_MODULE "noslip_adaptation.inc"
#include "noslip_scalars.inc"

#endif
