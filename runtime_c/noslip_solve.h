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

/* -- double: generated from noslip_solve.inc by guarantees/headers.py -------------------------------------------------- */

/* Returns the 1-norm of a matrix: the largest column sum of absolute values. */
static inline double noslip_norm(const double *matrix, int n)
{
    double norm = 0;
    int i, j;
    for (j = 0; j < n; j++) {
        double sum = 0;
        for (i = 0; i < n; i++) {
            sum += noslip_abs(matrix[i * n + j]);
        }
        norm = noslip_max(norm, sum);
    }
    return norm;
}

/*
 * Replaces a matrix by its inverse, by Gauss-Jordan elimination with partial pivoting. `order` is working memory for n numbers.
 * Returns the reciprocal condition number 1 / (|matrix| |inverse|) in the 1-norm: at most 1; 0 if the matrix is singular, the
 * inverse overflows, or an entry is not finite. In these cases the contents of the matrix are undefined.
 */
static inline double noslip_invert(double *matrix, int *order, int n)
{
    double condition = noslip_norm(matrix, n);
    int i, j, k;
    for (k = 0; k < n; k++) {
        double *row = matrix + k * n, scale;
        int best = k;
        for (i = k + 1; i < n; i++) {
            if (noslip_abs(matrix[i * n + k]) > noslip_abs(matrix[best * n + k])) {
                best = i;
            }
        }
        order[k] = best;
        if (!(noslip_abs(matrix[best * n + k]) > 0)) {
            return 0;
        }
        scale = 1 / matrix[best * n + k];
        matrix[best * n + k] = 1; /* of the identity: its column k is stored in column k of the matrix */
        for (j = 0; j < n; j++) {
            const double entry = matrix[best * n + j];
            matrix[best * n + j] = row[j];
            row[j] = entry * scale;
        }
        for (i = 0; i < n; i++) {
            double *other = matrix + i * n;
            const double factor = other[k];
            if (i == k) {
                continue;
            }
            other[k] = 0;
            for (j = 0; j < n; j++) {
                other[j] -= factor * row[j];
            }
        }
    }
    for (k = n - 1; k >= 0; k--) { /* exchanging rows of a matrix exchanges columns of its inverse */
        for (i = 0; i < n; i++) {
            const double entry = matrix[i * n + k];
            matrix[i * n + k] = matrix[i * n + order[k]];
            matrix[i * n + order[k]] = entry;
        }
    }
    condition *= noslip_norm(matrix, n);
    return condition > 0 && noslip_is_finite(condition) ? 1 / condition : 0;
}

/*
 * Factorizes a symmetric positive definite matrix as L D L' in place, reading only its lower triangle. L, whose diagonal is 1, is
 * stored below the diagonal and 1 / D on the diagonal. Returns NOSLIP_SINGULAR if a pivot is not above 1e-6
 * times the original diagonal entry, in float as in double: the matrix is not positive definite, or so nearly singular that float
 * has no correct digit left.
 */
static inline int noslip_ldl(double *matrix, int n)
{
    int i, j, k;
    for (i = 0; i < n; i++) {
        double *row = matrix + i * n, pivot = row[i];
        for (j = 0; j < i; j++) { /* L D */
            for (k = 0; k < j; k++) {
                row[j] -= row[k] * matrix[j * n + k];
            }
        }
        for (j = 0; j < i; j++) {
            const double scaled = row[j];
            row[j] *= matrix[j * n + j];
            pivot -= scaled * row[j];
        }
        if (!(pivot > 0 && pivot > row[i] * (double)1e-6 && noslip_is_finite(pivot))) {
            return NOSLIP_SINGULAR;
        }
        row[i] = 1 / pivot;
    }
    return NOSLIP_OK;
}

/* Replaces `right`, n numbers, by the solution x of matrix x = right; `factors` is the result of noslip_ldl. */
static inline void noslip_ldl_solve(const double *factors, double *right, int n)
{
    int i, j;
    for (i = 0; i < n; i++) {
        for (j = 0; j < i; j++) {
            right[i] -= factors[i * n + j] * right[j];
        }
    }
    for (i = 0; i < n; i++) {
        right[i] *= factors[i * n + i];
    }
    for (i = n - 1; i >= 0; i--) {
        for (j = i + 1; j < n; j++) {
            right[i] -= factors[j * n + i] * right[j];
        }
    }
}

/* -- float: generated from noslip_solve.inc by guarantees/headers.py --------------------------------------------------- */

/* Returns the 1-norm of a matrix: the largest column sum of absolute values. */
static inline float noslip_norm_f(const float *matrix, int n)
{
    float norm = 0;
    int i, j;
    for (j = 0; j < n; j++) {
        float sum = 0;
        for (i = 0; i < n; i++) {
            sum += noslip_abs_f(matrix[i * n + j]);
        }
        norm = noslip_max_f(norm, sum);
    }
    return norm;
}

/*
 * Replaces a matrix by its inverse, by Gauss-Jordan elimination with partial pivoting. `order` is working memory for n numbers.
 * Returns the reciprocal condition number 1 / (|matrix| |inverse|) in the 1-norm: at most 1; 0 if the matrix is singular, the
 * inverse overflows, or an entry is not finite. In these cases the contents of the matrix are undefined.
 */
static inline float noslip_invert_f(float *matrix, int *order, int n)
{
    float condition = noslip_norm_f(matrix, n);
    int i, j, k;
    for (k = 0; k < n; k++) {
        float *row = matrix + k * n, scale;
        int best = k;
        for (i = k + 1; i < n; i++) {
            if (noslip_abs_f(matrix[i * n + k]) > noslip_abs_f(matrix[best * n + k])) {
                best = i;
            }
        }
        order[k] = best;
        if (!(noslip_abs_f(matrix[best * n + k]) > 0)) {
            return 0;
        }
        scale = 1 / matrix[best * n + k];
        matrix[best * n + k] = 1; /* of the identity: its column k is stored in column k of the matrix */
        for (j = 0; j < n; j++) {
            const float entry = matrix[best * n + j];
            matrix[best * n + j] = row[j];
            row[j] = entry * scale;
        }
        for (i = 0; i < n; i++) {
            float *other = matrix + i * n;
            const float factor = other[k];
            if (i == k) {
                continue;
            }
            other[k] = 0;
            for (j = 0; j < n; j++) {
                other[j] -= factor * row[j];
            }
        }
    }
    for (k = n - 1; k >= 0; k--) { /* exchanging rows of a matrix exchanges columns of its inverse */
        for (i = 0; i < n; i++) {
            const float entry = matrix[i * n + k];
            matrix[i * n + k] = matrix[i * n + order[k]];
            matrix[i * n + order[k]] = entry;
        }
    }
    condition *= noslip_norm_f(matrix, n);
    return condition > 0 && noslip_is_finite_f(condition) ? 1 / condition : 0;
}

/*
 * Factorizes a symmetric positive definite matrix as L D L' in place, reading only its lower triangle. L, whose diagonal is 1, is
 * stored below the diagonal and 1 / D on the diagonal. Returns NOSLIP_SINGULAR if a pivot is not above 1e-6
 * times the original diagonal entry, in float as in double: the matrix is not positive definite, or so nearly singular that float
 * has no correct digit left.
 */
static inline int noslip_ldl_f(float *matrix, int n)
{
    int i, j, k;
    for (i = 0; i < n; i++) {
        float *row = matrix + i * n, pivot = row[i];
        for (j = 0; j < i; j++) { /* L D */
            for (k = 0; k < j; k++) {
                row[j] -= row[k] * matrix[j * n + k];
            }
        }
        for (j = 0; j < i; j++) {
            const float scaled = row[j];
            row[j] *= matrix[j * n + j];
            pivot -= scaled * row[j];
        }
        if (!(pivot > 0 && pivot > row[i] * (float)1e-6 && noslip_is_finite_f(pivot))) {
            return NOSLIP_SINGULAR;
        }
        row[i] = 1 / pivot;
    }
    return NOSLIP_OK;
}

/* Replaces `right`, n numbers, by the solution x of matrix x = right; `factors` is the result of noslip_ldl. */
static inline void noslip_ldl_solve_f(const float *factors, float *right, int n)
{
    int i, j;
    for (i = 0; i < n; i++) {
        for (j = 0; j < i; j++) {
            right[i] -= factors[i * n + j] * right[j];
        }
    }
    for (i = 0; i < n; i++) {
        right[i] *= factors[i * n + i];
    }
    for (i = n - 1; i >= 0; i--) {
        for (j = i + 1; j < n; j++) {
            right[i] -= factors[j * n + i] * right[j];
        }
    }
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
