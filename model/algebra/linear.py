"""Symbolic linear equations: solved in closed form, block by block, or by elimination with exact pivots."""

from collections.abc import Callable
from functools import reduce

import casadi as ca

from .exact import canonical
from .poles import added_pole, quotient, without_pole

COFACTORS = 5  # largest matrix, in rows, that is inverted by cofactors


def solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return matrix^-1 right, n x any, without a pivot that can vanish unless the determinant does.

    Uses cofactors up to n = 3; larger matrices are solved block by block, blocks above 3 by
    orthogonalization.
    """
    n = matrix.shape[0]
    if n > 3:
        return solve_by_blocks(matrix, right, _solve_block)
    determinant = canonical(ca.det(matrix))
    return ca.adj(matrix) @ right / determinant if n > 1 else right / matrix


def solve_symmetric(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return matrix^-1 right for a symmetric positive definite matrix: as `solve` up to 3 x 3,
    by L D L' above."""
    if matrix.shape[0] <= 3:
        return solve(matrix, right)
    D, U, order = ca.ldl(matrix)
    return ca.ldl_solve(ca.densify(right), D, U, order)


def solve_by_blocks(matrix: ca.SX, right: ca.SX, solve_block: Callable[[ca.SX, ca.SX], ca.SX]) -> ca.SX:
    """Return matrix^-1 right, after permuting rows and columns to a block triangular form.

    `solve_block` solves for one diagonal block. Zeros of the matrix must be structural.
    """
    matrix = ca.sparsify(matrix)
    count, rows, columns, starts, *_ = matrix.sparsity().btf()
    solution = ca.SX(*right.shape)
    for first, last in zip(starts[:count], starts[1 : count + 1], strict=True):
        i, j = rows[first:last], columns[first:last]
        solution[j, :] = solve_block(ca.densify(matrix[i, j]), right[i, :] - matrix[i, :] @ solution)
    return solution


def _solve_block(matrix: ca.SX, right: ca.SX) -> ca.SX:
    return solve(matrix, right) if matrix.shape[0] <= 3 else _orthogonally(matrix, right)


def _orthogonally(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return matrix^-1 right by the modified Gram-Schmidt process on the columns of [matrix right].

    There are no pivots and hence no branches. The accuracy is that of elimination with pivoting, because
    `right` is treated like the columns of the matrix.
    """
    n = matrix.shape[0]
    columns = ca.horzsplit(ca.densify(ca.horzcat(matrix, right)))
    table = ca.SX.zeros(n, len(columns))  # U with a diagonal of ones, followed by U x
    for k in range(n):
        square = ca.sumsqr(columns[k])
        for j in range(k + 1, len(columns)):
            table[k, j] = ca.dot(columns[k], columns[j]) / square
            columns[j] -= table[k, j] * columns[k]
    solution = table[:, n:]
    for k in reversed(range(n)):
        solution[k, :] -= table[k, k + 1 : n] @ solution[k + 1 :, :]
    return solution


def condition(matrix: ca.SX) -> ca.SX:
    """Return the condition number |matrix| |matrix^-1| in the 1-norm; large, infinite or NaN for a singular
    matrix.

    Where the matrix is exactly singular, `solve` may return numbers of ordinary size: the part r of a column
    a that does not depend on the columns before it is then rounding, in the numerator as well as in the
    denominator. Therefore the lower bound |a| / (sqrt(n) |r|) is taken into account: the matrix is singular
    at the distance |r|.
    """
    n = matrix.shape[0]
    number = norm(matrix) * norm(solve(matrix, ca.SX.eye(n)))
    if n <= 3:  # by cofactors, whose determinant is zero there
        return number
    columns = ca.horzsplit(ca.densify(matrix))
    for k in range(n):
        rest = columns[k]
        for column in columns[:k]:
            rest -= ca.dot(column, rest) / ca.sumsqr(column) * column
        number = larger(number, ca.norm_2(columns[k]) / (ca.norm_2(rest) * n**0.5))
        columns[k] = rest
    return number


def regularity(matrix: ca.SX, size: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return two nonnegative expressions whose quotient tells how far a matrix is from singular; `size`
    bounds its entries.

    Up to 2 x 2 these are |det matrix| and the product of the row norms of `size`; above, 1 and |size|
    |matrix^-1| in the 1-norm.
    """
    if matrix.shape[0] > 2:
        return ca.SX(1), norm(size) / norm(matrix) * condition(matrix)
    return ca.fabs(canonical(ca.det(matrix))), ca.sqrt(row_norms_squared(size))


def row_norms_squared(matrix: ca.SX) -> ca.SX:
    """Return the square of the product of the row norms, an upper bound of the square of the determinant."""
    product = ca.SX(1)
    for row in ca.vertsplit(matrix):
        product *= ca.sumsqr(row)
    return product


def norm(matrix: ca.SX) -> ca.SX:
    """Return the 1-norm, the largest column sum of absolute values; NaN if an entry is NaN."""
    return reduce(larger, ca.horzsplit(ca.densify(ca.sum1(ca.fabs(matrix)))))


def larger(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the larger of two numbers, without branches; NaN if one of them is NaN, unlike with fmax."""
    return (a + b + ca.fabs(a - b)) / 2


def eliminate(matrix: ca.SX, right: ca.SX, moving: ca.SX, name: str) -> ca.SX:
    """Return matrix^-1 right in canonical form, with poles only where the determinant vanishes.

    Uses elimination with pivots that are as simple as possible; if one of them remains in the result as a
    pole, cofactors, block by block. `moving` are the symbols that may have any value including zero; the
    others are positive. Raises ModelError with the name of the robot if a pole remains.
    """
    solution = _by_pivots(matrix, right)
    if added_pole(solution, (matrix, right), quotient, moving) is None:
        return solution
    return without_pole(name, "S", _by_cofactors(matrix, right), (matrix, right), quotient, moving)


def _by_cofactors(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return matrix^-1 right, blocks up to COFACTORS by cofactors, larger ones by elimination."""

    def solve_block(block: ca.SX, side: ca.SX) -> ca.SX:
        if block.shape[0] > COFACTORS:
            return _by_pivots(block, side)
        adjoint = canonical(ca.adj(block)) if block.shape[0] > 1 else ca.SX(1)
        return canonical(canonical(adjoint @ side) / canonical(ca.det(block)))

    return ca.sparsify(solve_by_blocks(canonical(matrix), ca.densify(right), solve_block))


def _by_pivots(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return matrix^-1 right by elimination with exact simplification after every step.

    A pivot that vanishes somewhere cancels from the result unless the determinant vanishes there too, or the
    simplification does not detect it.
    """
    n = matrix.shape[0]
    table = canonical(ca.densify(ca.horzcat(matrix, right)))
    remaining = list(range(n))
    order = {}
    for _ in range(n):
        row, column = min(
            ((i, j) for i in remaining for j in range(n) if j not in order and not table[i, j].is_zero()),
            key=lambda place: _difficulty(table[place]),
        )
        pivot = table[row, :] / table[row, column]
        pivot[column] = 1
        pivot = canonical(pivot)
        table = ca.densify(table)
        table[row, :] = pivot
        for i in range(n):
            if i != row and not table[i, column].is_zero():
                reduced = table[i, :] - table[i, column] * pivot
                reduced[column] = 0
                table[i, :] = canonical(reduced)
        order[column] = row
        remaining.remove(row)
    return ca.sparsify(ca.vertcat(*[table[order[column], n:] for column in range(n)]))


def _difficulty(pivot: ca.SX) -> tuple[bool, int]:
    return not pivot.is_constant(), ca.n_nodes(pivot)
