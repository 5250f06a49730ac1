/*
 * noslip_factors.h - a covariance as P = U D U', with U upper triangular with ones on its diagonal, and D diagonal and positive.
 *
 * Packed by columns: those of U above its diagonal, and in place of the one the entry of D. Rounding cannot make a variance
 * negative. noslip_ekf.h and noslip_adaptation.h use it.
 */
#ifndef NOSLIP_FACTORS_H
#define NOSLIP_FACTORS_H

#include "noslip_real.h"

#define NOSLIP_MODULE "noslip_factors.inc"
#include "noslip_scalars.inc"

#endif
