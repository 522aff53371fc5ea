"""A sphere in dark pictures, as files of 8 or 16 bits hold it."""

from dataclasses import replace

import numpy as np
import torch

import photonormal as pn
from photonormal.geometry import fibonacci_hemisphere
from photonormal.methods import configure
from photonormal.methods.engine import on_mask, run
from tests.scenes import sphere

N_LIGHTS, BRIGHTEST = 60, 20


class Files:
    """Pictures as files of 8 bits store them, over the intensities of their lights."""

    dtype = np.dtype(np.uint8)

    def __init__(self, counts, intensities):
        self.counts, self.intensities, self.shape = counts, intensities, counts.shape

    def __getitem__(self, j):
        full = np.float32(np.iinfo(self.dtype).max)
        return (self.counts[j] / full / self.intensities[j]).astype(np.float32)


def dark(stored, even=False, faulty=0, gloss=0.0, brightest=BRIGHTEST, hue=(1.0, 1.0, 1.0)):
    """A sphere whose brightest sample has so many levels; `stored` makes whole numbers of what the sensor saw."""
    g = np.random.default_rng(0)
    truth = sphere()
    N, L = truth.map, fibonacci_hemisphere(2 * N_LIGHTS)
    L = L[np.argsort(-L[:, 2])[:N_LIGHTS]]
    e = np.ones(N_LIGHTS) if even else g.uniform(0.4, 1, N_LIGHTS)
    cos = np.clip(N @ L.T, 0, None).transpose(2, 0, 1)  # (n, h, w)
    half = L + np.array([0, 0, 1])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    I = cos + gloss * np.clip(N @ half.T, 0, None).transpose(2, 0, 1) ** 30 * (cos > 0)
    I[:faulty] *= 0.6
    counts = stored((e[:, None, None] * I / (I * e[:, None, None]).max() * brightest)[..., None] * hue)
    images = Files(counts, np.repeat(e[:, None], 3, 1))
    return pn.Capture(images, truth.mask, L, truth=truth, saturation=(1 / images.intensities).astype(np.float32))


def in_16_bits(capture, step, first):
    """The same photographs in files of 16 bits, a level stored as `step` steps from the `first`."""
    images = Files(
        capture.images.counts.astype(np.uint16) * np.uint16(step) + np.uint16(first), capture.images.intensities
    )
    images.dtype = np.dtype(np.uint16)
    return replace(capture, images=images)


def in_memory(capture):
    """Its pictures, of which nothing tells how they were stored."""
    return np.stack([capture.images[j] for j in range(N_LIGHTS)])


def error_deg(capture, method="l1"):
    method = configure(method)
    return pn.score(on_mask(run(method, capture, torch.device("cpu")), capture), capture.truth).mean_deg
