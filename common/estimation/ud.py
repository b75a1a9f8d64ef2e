"""A covariance kept as P = U D U' (U unit upper triangular, D diagonal), in plain floats.

Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapter V: D stays positive and P
symmetric whatever the rounding, without square roots. Up to about ten parameters, plain floats are several
times faster than numpy.
"""

from collections.abc import Sequence

Matrix = list[list[float]]


class UdCovariance:
    """P for n parameters; starts as a diagonal matrix."""

    def __init__(self, diagonal: Sequence[float]) -> None:
        self._d = list(diagonal)
        self._u: Matrix = [[0.0] * j for j in range(len(self._d))]  # column j of U, above the diagonal

    def project(self, phi: Sequence[float]) -> tuple[list[float], list[float], float]:
        """(f, v, power) with f = U' phi, v = D f and power = phi' P phi."""
        f: list[float] = []
        v: list[float] = []
        d = self._d
        power = 0.0
        for j, column in enumerate(self._u):
            f_j = phi[j]
            for i, u in enumerate(column):
                f_j += u * phi[i]
            v_j = d[j] * f_j
            power += f_j * v_j
            f.append(f_j)
            v.append(v_j)
        return f, v, power

    def correct(self, f: list[float], v: list[float], lam: float) -> tuple[list[float], float]:
        """P = (I - K phi') P / lambda for the phi that gave f and v; returns (P phi, alpha), the gain being K
        = P phi / alpha.

        `v` is used up: it becomes P phi (before the correction).
        """
        d = self._d
        alpha = lam
        for j, column in enumerate(self._u):
            f_j, v_j, before = f[j], v[j], alpha
            alpha += f_j * v_j
            d[j] *= before / (alpha * lam)
            p = f_j / before
            for i, u in enumerate(column):
                k = v[i]
                column[i] = u - k * p
                v[i] = k + u * v_j
        return v, alpha

    def inform(self, i: int, information: float) -> None:
        """Adds to element (i, i) of inv(P): a measurement of parameter i alone."""
        phi = [0.0] * len(self._d)
        phi[i] = information**0.5
        f, v, _ = self.project(phi)
        self.correct(f, v, 1.0)

    @property
    def matrix(self) -> Matrix:
        """P, exactly symmetric."""
        n = len(self._d)
        u = [[self._u[j][i] if i < j else float(i == j) for j in range(n)] for i in range(n)]
        p = [[0.0] * n for _ in range(n)]
        for i in range(n):
            for j in range(i, n):
                p[i][j] = p[j][i] = sum(u[i][k] * self._d[k] * u[j][k] for k in range(j, n))
        return p

    @classmethod
    def factorised(cls, p: Matrix) -> "UdCovariance":
        """The factors of a symmetric positive definite matrix."""
        n = len(p)
        rest = [list(row) for row in p]
        factors = cls([0.0] * n)
        for j in range(n - 1, -1, -1):
            factors._d[j] = d = rest[j][j]
            factors._u[j] = column = [rest[i][j] / d for i in range(j)]
            for k in range(j):
                for i in range(k + 1):
                    rest[i][k] -= column[i] * column[k] * d
        return factors
