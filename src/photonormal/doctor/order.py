"""Lights given in another order than the pictures.

Under the Lambertian model the pictures of a pixel lie in the span of the lights: i = L b. The part of all samples
outside it is 1 - tr(P G) / tr G, with P = L L^+ and the Gram matrix G = sum_p i_p i_p^T of the pictures. Another order
permutes G, so that it costs n^2 operations to try one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

SUSPECT = 0.05  # misfit, 0 as low as three dimensions allow, 1 as bad as chance, above which orders are tried
BETTER = 0.5  # misfit of another order, as part of the given one's, at which it is reported
AT_LEAST = 0.06  # and by how much it has to fall
EQUAL = 0.02  # misfits that differ by less are the same
GOOD, FREE = 0.4, 0.12  # misfit that another order has at most, and one that no simple rule makes: some fit by chance
NEIGHBOURS_DEG = 10.0  # between lights whose exchange changes little
FEW = 8  # lights of which an exchange of two changes the misfit by more than EQUAL; of more lights, by less
PARTS = 8  # of the pixels, evenly spread, which have to agree on an order
TURNS = 24  # rotations about the lights' mean from which a match starts
DARKEST = 0.2  # of the pixels are left out
CHANCE = 20  # random orders that show how bad chance is


@dataclass(frozen=True)
class Orders:
    """How well orders of the pictures fit the lights; `order[i]` is the picture that belongs to light i."""

    G: Float[np.ndarray, "n n"]
    L: Float[np.ndarray, "n 3"]
    parts: Float[np.ndarray, "k n n"]  # what some of the pixels each add to G

    @classmethod
    def of(cls, I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"]) -> Orders:
        """From grey levels; every pixel counts the same, so that bright paint does not."""
        size = np.linalg.norm(I, axis=1)
        J = I[size > np.quantile(size, DARKEST)]
        J = J / np.linalg.norm(J, axis=1, keepdims=True)
        parts = np.stack([J[k::PARTS].T @ J[k::PARTS] for k in range(PARTS)]) / max(len(J), 1)
        return cls(parts.sum(0), L, parts)

    def outside(self, order: Int[np.ndarray, " n"]) -> float:
        """Root of the part of all samples that no surface explains."""
        P = self.L @ np.linalg.pinv(self.L)
        return self._rest((P * self.G[np.ix_(order, order)]).sum())

    def scale(self) -> tuple[float, float]:
        """What three dimensions leave outside at least, and what a random order does."""
        rng, n = np.random.default_rng(0), len(self.L)
        floor = self._rest(np.linalg.eigvalsh(self.G)[-3:].sum())
        return floor, float(np.mean([self.outside(rng.permutation(n)) for _ in range(CHANCE)]))

    def _rest(self, explained: float) -> float:
        """Root of the part of all samples that is not `explained`; none where there are no samples."""
        whole = float(np.trace(self.G))
        return float(np.sqrt(max(0.0, 1 - explained / whole))) if whole > 0 else 0.0

    def misfit(self, order: Int[np.ndarray, " n"]) -> float:
        """0 as low as three dimensions allow, 1 as bad as chance."""
        floor, chance = self.scale()
        return (self.outside(order) - floor) / max(chance - floor, 1e-6)

    def principal(self) -> Float[np.ndarray, "n 3"]:
        """Three columns that explain more than any lights do; orthonormal."""
        return np.linalg.eigh(self.G)[1][:, -3:]

    def better(self, names: Sequence[str]) -> list[Int[np.ndarray, " n"]]:
        """Orders that fit much better than the given one, best first, simple ones before others; none if it fits."""
        n, (floor, chance) = len(self.L), self.scale()
        given = np.arange(n)
        spread = max(chance - floor, 1e-6)
        start = (self.outside(given) - floor) / spread
        if n < 5 or start < SUSPECT or chance - floor < 1e-3:
            return []
        simple = [order for order, _ in simple_orders(names)]
        tried = [*simple, self.climb(given), *(self.climb(o) for o in self.matches())]
        misfit = np.array([(self.outside(o) - floor) / spread for o in tried])
        misfit[len(simple) :][misfit[len(simple) :] > FREE] = np.inf
        best = misfit.min()
        if best > min(GOOD, BETTER * start) or start - best < AT_LEAST:
            return []
        chosen: list[np.ndarray] = []
        for k in sorted(np.flatnonzero(misfit < best + EQUAL), key=lambda k: (k >= len(simple), misfit[k])):
            if not any((tried[k] == o).all() for o in chosen):
                chosen.append(tried[k])
        return chosen

    def sure(self, order: Int[np.ndarray, " n"]) -> bool:
        """Whether no exchange of two lights that are not neighbours leaves the pictures explained as well.

        Neither all of them, nor those of any part of the pixels.
        """
        floor, chance = self.scale()
        equal = EQUAL * min(1.0, FEW / len(order))
        limit = (floor + (self.misfit(order) + equal) * (chance - floor)) ** 2  # of what may be left outside
        as_good = self.outside(order) ** 2 - self._gains(order, self.G) / np.trace(self.G) < limit
        for G in self.parts:
            as_good |= self._gains(order, G) > 0
        return not (np.triu(as_good, 1) & (self.L @ self.L.T < np.cos(np.radians(NEIGHBOURS_DEG)))).any()

    def climb(self, order: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Swap two pictures as long as that helps, the best swap first."""
        order = order.copy()
        for _ in range(4 * len(order)):
            gain = self._gains(order, self.G)
            a, b = divmod(int(gain.argmax()), len(order))
            if gain[a, b] < 1e-9:
                break
            order[[a, b]] = order[[b, a]]
        return order

    def _gains(self, order: Int[np.ndarray, " n"], G: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
        """By how much tr(P G) grows where two pictures are exchanged."""
        P, H = self.L @ np.linalg.pinv(self.L), G[np.ix_(order, order)]
        PH, p, h = P @ H, np.diag(P), np.diag(H)
        d = np.diag(PH)
        gain = 2 * (PH + PH.T - d[:, None] - d) + (p[:, None] + p - 2 * P) * (h[:, None] + h - 2 * H)
        np.fill_diagonal(gain, 0)
        return gain

    def matches(self) -> list[Int[np.ndarray, " n"]]:
        """Orders found by laying the pictures' three strongest directions over the lights.

        The pictures' principal vectors are the lights up to a linear map. Orthonormalised, both are point sets that
        differ by a rotation or a mirroring; which one, and which point is which, is found by assigning and turning in
        alternation, from many turns about the lights' mean.
        """
        from scipy.optimize import linear_sum_assignment

        u, _, vt = np.linalg.svd(self.L, full_matrices=False)
        U, S = u @ vt, self.principal()  # (n, 3) both
        to, back = _frame(U.mean(0)), _frame(S.mean(0))
        found = {}
        for mirror in (1.0, -1.0):
            for phi in 2 * np.pi * np.arange(TURNS) / TURNS:
                c, s = np.cos(phi), np.sin(phi)
                turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([mirror, 1, 1])
                T, order = S @ back @ turn @ to.T, np.arange(len(U))
                for _ in range(6):
                    before, (_, order) = order, linear_sum_assignment(-(U @ T.T))  # rows come in their order
                    if (order == before).all():
                        break
                    a, _, b = np.linalg.svd(S[order].T @ U)
                    T = S @ (a @ b)
                found[order.tobytes()] = order
        best = sorted(found.values(), key=self.outside)[:6]
        limit = self.outside(best[0]) + 0.1 * (self.scale()[1] - self.outside(best[0]))
        return [o for o in best if self.outside(o) <= limit]


def simple_orders(names: Sequence[str]) -> list[tuple[Int[np.ndarray, " n"], str]]:
    """Orders that people's files come in, and what to call them: light i belongs to picture order[i]."""
    n = len(names)
    k = np.arange(n)
    found = [(k[::-1], "the reversed order")]
    by_name = np.array(sorted(k, key=lambda j: names[int(j)]))  # 1, 10, 11, 2: as some programs list files
    if (by_name != k).any():
        found += [(by_name, "the order of the names as text (1, 10, 11, 2, ...)")]
        found += [(np.argsort(by_name), "counted order (1, 2, ..., 10) where the lights follow the names as text")]
    numbered = np.array(sorted(k, key=lambda j: str(j + 1)))
    if (numbered != k).any():
        found += [(np.argsort(numbered), "the order 1, 10, 11, 2, ... of the pictures' numbers as text")]
        found += [(numbered, "the order 1, 10, 11, 2, ... of the lights' numbers as text")]
    for shift in range(1, n):
        found.append((np.roll(k, -shift), f"the order shifted by {shift if shift <= n // 2 else shift - n}"))
    for rows in range(2, n // 2 + 1):
        if n % rows == 0:
            found.append((k.reshape(rows, -1).T.ravel(), f"a grid of {rows} rows read column by column"))
            snake = k.reshape(rows, -1).copy()
            snake[1::2] = snake[1::2, ::-1]
            found.append((snake.ravel(), f"a grid of {rows} rows with every second row reversed"))
    for shift in range(1, n):
        found.append(
            (np.roll(k[::-1], -shift), f"the reversed order shifted by {shift if shift <= n // 2 else shift - n}")
        )
    return found


def order_name(order: Int[np.ndarray, " n"], names: Sequence[str]) -> str:
    """What an order is called: one of `simple_orders`, a swap, or how many lights are with the wrong picture."""
    for simple, name in simple_orders(names):
        if (simple == order).all():
            return name
    moved = np.flatnonzero(order != np.arange(len(order)))
    if len(moved) == 2:
        return f"the lights of {names[moved[0]]} and {names[moved[1]]} exchanged"
    return f"an order in which {len(moved)} of {len(order)} lights go to other pictures"


def _frame(v: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Orthonormal columns, the last along `v`."""
    v = v / np.linalg.norm(v)
    a = np.cross(v, [1.0, 0, 0] if abs(v[0]) < 0.9 else [0.0, 1, 0])
    a /= np.linalg.norm(a)
    return np.stack([a, np.cross(v, a), v], axis=1)
