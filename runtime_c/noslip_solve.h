/*
 * noslip_solve.h - linear equations that are too many for a closed form: any square matrix by elimination with pivots, a
 * symmetric positive definite one by L D L'.
 *
 * Matrices are arrays of the caller, n x n, row by row; nothing limits n. The number of operations depends on n only, but for
 * the rows that elimination exchanges.
 *
 * Each function exists for double and, with the suffix _f, for float; both come from noslip_solve.inc.
 */
#ifndef NOSLIP_SOLVE_H
#define NOSLIP_SOLVE_H

#include "noslip_real.h"
#include "noslip_status.h"

#define NOSLIP_REAL double
#define NOSLIP_NAME(name) name
#include "noslip_solve.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#define NOSLIP_REAL float
#define NOSLIP_NAME(name) name##_f
#include "noslip_solve.inc"
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#endif
