/*
 * noslip_solve.h - linear equations of any size: a square matrix by elimination with pivoting, a symmetric positive
 * definite one by L D L'.
 *
 * Matrices are arrays of the caller, n x n, in row-major order; n is not limited. The number of operations depends on n only,
 * except for the row exchanges of the elimination.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_SOLVE_H
#define NOSLIP_SOLVE_H

#include "noslip_functions.h"
#include "noslip_real.h"
#include "noslip_status.h"

#define NOSLIP_MODULE "noslip_solve.inc"
#include "noslip_scalars.inc"

#endif
