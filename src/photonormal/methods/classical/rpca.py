"""Rank minimisation: L. Wu, A. Ganesh, B. Shi, Y. Matsushita, Y. Wang, Y. Ma, ACCV 2010 (robust PCA)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.woodham import scaled_normals
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.inputs.grey import lit
from photonormal.options import Effort, Positive
from photonormal.shading import normalised

FEW = 512  # images up to which all singular vectors are found; of more only those that are needed:
RANK = 16  # so many at first
PASSES = 4  # of subspace iteration


@dataclass(frozen=True)
class RPCA:
    """min |A|_* + lambda |E|_1 with D = A + E on the lit samples, over all pixels at once; then n ~ A L^+.

    A is the matt part of the images D, of low rank; E are its sparse highlights; shadows count as missing. By the
    inexact augmented Lagrangian of Lin, Chen and Ma (2009), a Gram matrix in place of the singular value decomposition;
    of more than 512 images within the span of the largest singular vectors. Needs 4 lights.

    Parameters
    ----------
    sparsity : lambda is this times 1 + 20 / n over the root of the larger side of D: of few images even the matt part
        is not of low rank, and a small lambda would take it apart
    growth : factor of the penalty mu from step to step
    tolerance : |D - A - E| / |D| at which to stop
    steps : at most
    """

    sparsity: Positive = 0.6
    growth: Positive = 1.5
    tolerance: Positive = 1e-4
    steps: Effort = 60

    needs: ClassVar[Needs] = Needs(images=4, reads="object")

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.normals(seen.I.to(seen.lights), seen.lights))

    def normals(
        self, I: Float[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"], dark: float | None = None
    ) -> Float[Tensor, "*b p 3"]:
        """Unit normals from grey levels and lights; leading batch dimensions are allowed. `dark`: see `Prior`."""
        A = self.low_rank(I, lit(I, dark))
        A = torch.where(A.any(-1, keepdim=True), A, I)  # where all is highlight: least squares
        return normalised(scaled_normals(A, L) * (I > 0).any(-1, keepdim=True))

    def low_rank(self, D: Float[Tensor, "*b p n"], keep: Bool[Tensor, "*b p n"]) -> Float[Tensor, "*b p n"]:
        """A of D = A + E, where samples not to `keep` are missing. U is the multiplier divided by mu."""
        size = (-2, -1)
        norm = spectral_norm(D)
        p, n = D.shape[-2:]
        lam = self.sparsity * (1 + 20 / n) / max(p, n) ** 0.5
        mu = 1.25 / norm  # (*b, 1, 1)
        U = D / torch.maximum(norm, D.abs().amax(size, keepdim=True) / lam) / mu
        M = D + U  # D - E + U, E = 0
        length = D.norm(dim=size).clamp(min=1e-30)
        A = M
        for _ in range(self.steps):
            A = shrink_singular_values(M, 1 / mu)
            T = (D - A).add_(U)
            C = torch.minimum(torch.maximum(T, -lam / mu), lam / mu).mul_(
                keep
            )  # E = T - C: soft threshold; T if missing
            misfit = torch.linalg.vector_norm(C - U, dim=size) / length
            M = (A - U).add_(C, alpha=1 + 1 / self.growth)
            U = C.div_(self.growth)
            mu = mu * self.growth
            if bool((misfit < self.tolerance).all()):
                break
        return A


def gram(M: Float[Tensor, "*b p n"]) -> Float[Tensor, "*b n n"]:
    """M^T M in double precision."""
    return (M.transpose(-1, -2) @ M).double()


def spectral_norm(M: Float[Tensor, "*b p n"]) -> Float[Tensor, "*b 1 1"]:
    """The largest singular value."""
    if M.shape[-1] > FEW:
        M = M @ leading(M, torch.inf)
    return torch.linalg.eigvalsh(gram(M))[..., -1:, None].clamp(min=1e-30).sqrt().to(M.dtype)


def shrink_singular_values(M: Float[Tensor, "*b p n"], by: Float[Tensor, "*b 1 1"]) -> Float[Tensor, "*b p n"]:
    """U (S - by)_+ V^T of M = U S V^T, through the eigenvectors of M^T M, of which there are few."""
    if M.shape[-1] > FEW:
        Q = leading(M, by)
        if Q.shape[-1] < M.shape[-1]:
            return shrink_singular_values(M @ Q, by) @ Q.transpose(-1, -2)
    values, V = torch.linalg.eigh(gram(M))
    s = values.clamp(min=0).sqrt()  # (*b, n)
    kept = ((s - by[..., 0]).clamp(min=0) / s.clamp(min=1e-30))[..., None, :]
    return M @ ((V * kept) @ V.transpose(-1, -2)).to(M.dtype)


def leading(M: Float[Tensor, "*b p n"], beyond: Float[Tensor, "*b 1 1"] | float) -> Float[Tensor, "*b n k"]:
    """Orthonormal, the span of the right singular vectors whose values are `beyond` this, by subspace iteration."""
    n, rank = M.shape[-1], RANK
    while True:
        Q = torch.randn(n, min(rank, n), generator=torch.Generator().manual_seed(0)).to(M)
        for _ in range(PASSES):
            Q = torch.linalg.qr(M.transpose(-1, -2) @ (M @ Q)).Q
        least = torch.linalg.eigvalsh(gram(M @ Q))[..., :1, None].clamp(min=0).sqrt()
        if rank >= n or bool((least < beyond).all()):
            return Q
        rank *= 2
