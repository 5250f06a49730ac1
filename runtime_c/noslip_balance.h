/*
 * noslip_balance.h - linear state feedback about rest, for robots with fewer inputs than degrees of freedom, such as a balancer.
 *
 *     tau = rest - K (state - desired)
 *
 * with the gains K of an LQR at rest; `noslip generate balancer --lqr pitch=10 x=40 ...` writes them as a header. The position is compared in axes along the desired heading, so that gains that were found at heading 0 hold for any.
 *
 *     noslip_balance_f balance;
 *     status = balancer_lqr_init_f(&balance);
 *     status = noslip_balance_step_f(&balance, state, desired, tau);
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_BALANCE_H
#define NOSLIP_BALANCE_H

#include "noslip_controller.h"

#define NOSLIP_BALANCE_STATES 64 /* at most */
#define NOSLIP_BALANCE_INPUTS 8  /* at most */

#define NOSLIP_MODULE "noslip_balance.inc"
#include "noslip_scalars.inc"

#endif
