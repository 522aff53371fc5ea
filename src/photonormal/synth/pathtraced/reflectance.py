"""Reflectance formulas for Mitsuba: the published equations once more, written against its array library.

A formula is called with cosines (n.l, n.v, n.h and l.h = v.h) and returns f in 1/sr, one value a channel.
"""

from __future__ import annotations

import csv
import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from photonormal.synth.pathtraced.variant import mitsuba
from photonormal.types import InputError, by_name

FITS = {"sgd": "merl_sgd.csv", "abc": "merl_abc.csv"}  # family -> table of its parameters
ATTRIBUTES = ("vertex_base", "vertex_surface", "vertex_cloth", "vertex_coat")  # three numbers each
BRIGHTEST = 60.0  # bound of pi f: a white matt surface has 1


def fitted_parameters(folder: Path, family: str) -> dict[str, np.ndarray]:
    """Parameters of the fitted materials by name: (33,) of `sgd`, (9,) of `abc`.

    Raises
    ------
    InputError
        If there is no such family, or its table is missing or damaged.
    """
    path = folder / by_name("fitted materials", family, FITS)
    width = {"sgd": 33, "abc": 9}[family]
    try:
        with path.open(newline="") as file:
            rows = list(csv.reader(file))[1:]
        table = {row[0]: np.array(row[1 : 1 + width], np.float64) for row in rows}
    except (OSError, ValueError, IndexError) as error:
        raise InputError(
            f"{path} can't be read as a table of materials ({error}); give the folder that has it."
        ) from None
    if not table or any(v.shape != (width,) for v in table.values()):
        raise InputError(f"{path} has no or incomplete rows but {width} parameters a material are needed; restore it.")
    return dict(sorted(table.items()))


def diffuse(albedo: Any) -> dict[str, Any]:
    """Mitsuba's own Lambertian material."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": [float(a) for a in albedo]}}


def bsdf(family: str, values: Any, bound: float = BRIGHTEST) -> Any:
    """A Mitsuba material with the formula `family` of FORMULAS.

    Parameters
    ----------
    values : numbers (k,), or for "principled" also None: its eleven numbers come from the mesh's attributes, three
        each and the last two: `vertex_base`, `vertex_surface`, `vertex_cloth` and `vertex_coat`
    bound : pi f is never more
    """
    mi = mitsuba()
    made = _formula_bsdf()(mi.Properties())
    made.formula, made.values, made.bound = FORMULAS[family], None, bound / math.pi
    if values is not None:
        import drjit as dr

        made.values = [mi.Float(float(v)) for v in values]
        for v in made.values:
            dr.make_opaque(v)  # so that the next material reuses the compiled kernel
        made.alpha = mi.Float(lobe_width(family, values))
        dr.make_opaque(made.alpha)
    return made


def lobe_width(family: str, values: Any) -> float:
    """GGX roughness whose highlight is as wide as a material's at half its height, for choosing directions."""
    ch = np.cos(np.radians(np.linspace(0, 60, 601)))
    f = evaluate(family, values, np.full_like(ch, 0.7), np.full_like(ch, 0.7), ch, np.full_like(ch, 0.7)).mean(0)
    f = f - f[-1]
    half = int(np.argmax(f < f[0] / 2)) if f[0] > 1e-6 else len(ch) - 1
    tan = math.sqrt(max(1 / ch[max(half, 1)] ** 2 - 1, 1e-8))
    return float(np.clip(tan / math.sqrt(math.sqrt(2) - 1), 0.03, 1.0))


def evaluate(family: str, values: Any, cl: np.ndarray, cv: np.ndarray, ch: np.ndarray, cd: np.ndarray) -> np.ndarray:
    """f of a material at arrays of cosines (p,): (3, p)."""
    mi = mitsuba()
    numbers = [mi.Float(float(v)) for v in values]
    if not str(mi.variant()).startswith("scalar"):
        f = FORMULAS[family](mi, numbers, *(mi.Float(c.astype(np.float32)) for c in (cl, cv, ch, cd)))
        return np.array(f).reshape(3, -1)
    cosines = zip(*(c.tolist() for c in (cl, cv, ch, cd)), strict=True)
    return np.array([np.array(FORMULAS[family](mi, numbers, *c)) for c in cosines]).T


def _abc(mi: Any, v: list[Any], cl: Any, cv: Any, ch: Any, cd: Any) -> Any:
    """ABC (J. Löw et al., TOG 2012): k_d / pi + F D G / (pi cos_l cos_v), D = A / (1 + B (1 - cos_h))^C."""
    import drjit as dr

    kd, A, (B, C, ior) = mi.Color3f(*v[0:3]), mi.Color3f(*v[3:6]), v[6:9]
    D = dr.power(1 + B * (1 - ch), -C)
    G = dr.minimum(1, 2 * ch * dr.minimum(cl, cv) / cd)
    g = dr.sqrt(ior * ior + cd * cd - 1)
    a, b = (g - cd) / (g + cd), (cd * (g + cd) - 1) / (cd * (g - cd) + 1)
    F = 0.5 * a * a * (1 + b * b)
    return kd / math.pi + A * (F * D * G / (math.pi * cl * cv))


def _sgd(mi: Any, v: list[Any], cl: Any, cv: Any, ch: Any, cd: Any) -> Any:
    """SGD (M. Bagher et al., CGF 2012): (rho_d + rho_s F D G G / (cos_l cos_v)) / pi, each channel by itself."""
    import drjit as dr

    channels = []
    tan2 = 1 / (ch * ch) - 1
    for i in range(3):
        rho_d, rho_s, alpha, p, f0, f1, kappa, lam, c, k, theta0 = v[i::3]

        def G(cos: Any, lam: Any = lam, c: Any = c, k: Any = k, theta0: Any = theta0) -> Any:
            beyond = dr.maximum(0, dr.acos(cos) - theta0)
            grown = dr.select(beyond > 0, dr.power(dr.maximum(beyond, 1e-9), k), 0)
            return dr.clip(1 + lam * (1 - dr.exp(c * grown)), 0, 1)

        a = alpha + tan2 / alpha
        cos4: Any = (ch * ch) * (ch * ch)
        D = kappa * dr.exp(-a) / (math.pi * cos4 * dr.power(a, p))
        F = dr.maximum(0, f0 - cd * f1 + (1 - cd) ** 5 * (1 - f0))
        channels.append((rho_d + rho_s * F * D * G(cl) * G(cv) / (cl * cv)) / math.pi)
    return mi.Color3f(*channels)


def _principled(mi: Any, v: list[Any], cl: Any, cv: Any, ch: Any, cd: Any) -> Any:
    """Burley 2012; base colour, metallic, roughness, specular, tint, sheen, its tint, coat, its gloss."""
    import drjit as dr

    base, (metallic, rough, specular, tint, sheen, sheen_tint, coat, gloss) = mi.Color3f(*v[0:3]), v[3:11]

    def mix(a: Any, b: Any, t: Any) -> Any:
        return a * (1 - t) + b * t

    F = (1 - cd) ** 5
    F90 = 0.5 + 2 * rough * cd * cd
    matt = base / math.pi * ((1 - metallic) * mix(1, F90, (1 - cl) ** 5) * mix(1, F90, (1 - cv) ** 5))
    hue = base / dr.maximum(0.3 * base.x + 0.6 * base.y + 0.1 * base.z, 1e-3)
    white = mi.Color3f(1)
    F0 = mix(dr.minimum(0.08 * specular * mix(white, hue, tint), 1), base, metallic)

    def smith(cos: Any, k: Any) -> Any:
        return 1 / (cos + dr.sqrt(k + (1 - k) * cos * cos))

    a2 = dr.maximum(rough * rough, 1e-3) ** 2
    D = a2 / (math.pi * (1 + (a2 - 1) * ch * ch) ** 2)
    c2 = mix(0.1, 0.01, gloss) ** 2
    Dc = (c2 - 1) / (math.pi * dr.log(c2) * (1 + (c2 - 1) * ch * ch))
    coated = 0.25 * coat * Dc * mix(0.04, 1, F) * smith(cl, 0.0625) * smith(cv, 0.0625)
    cloth = mix(white, hue, sheen_tint) * (F * sheen * (1 - metallic))
    return matt + mix(F0, white, F) * (D * smith(cl, a2) * smith(cv, a2)) + cloth + mi.Color3f(coated)


FORMULAS = {"abc": _abc, "sgd": _sgd, "principled": _principled}


@lru_cache(maxsize=1)
def _formula_bsdf() -> Any:
    """The class, made once Mitsuba is there: its base class belongs to a variant."""
    import drjit as dr

    mi = mitsuba()

    class Formula(mi.BSDF):  # type: ignore[name-defined]
        """An opaque material seen from its front; directions from a cosine and a GGX lobe in equal parts."""

        formula: Any
        values: Any
        alpha: Any = 0.3
        bound: float

        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags]
            self.m_flags = flags

        def parameters(self, si: Any, active: Any) -> list[Any]:
            if self.values is not None:
                return self.values
            threes = [si.shape.eval_attribute_3(name, si, active) for name in ATTRIBUTES]
            return [value for three in threes for value in (three.x, three.y, three.z)][:11]

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            cl, cv = wo.z, si.wi.z
            h = dr.normalize(wo + si.wi)
            cd = dr.dot(wo, h)
            tiny = [dr.clip(c, 1e-3, 1) for c in (cl, h.z, cd)]
            f = self.formula(mi, self.parameters(si, active), tiny[0], dr.clip(cv, 0.05, 1), tiny[1], tiny[2])
            f = dr.clip(f, 0, self.bound) * cl
            return dr.select(active & (cl > 0) & (cv > 0), f, mi.Color3f(0))

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            h = dr.normalize(wo + si.wi)
            lobe = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.alpha, self.alpha, False)
            glossy = lobe.pdf(si.wi, h) / (4 * dr.maximum(dr.dot(wo, h), 1e-4))
            p = 0.5 * mi.warp.square_to_cosine_hemisphere_pdf(wo) + 0.5 * glossy
            return dr.select(active & (wo.z > 0) & (si.wi.z > 0), p, 0)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            lobe = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, self.alpha, self.alpha, False)
            m, _ = lobe.sample(si.wi, sample2)
            matt = mi.warp.square_to_cosine_hemisphere(sample2)
            bs = mi.BSDFSample3f()
            bs.wo = dr.select(sample1 < 0.5, matt, mi.reflect(si.wi, m))
            bs.pdf = self.pdf(ctx, si, bs.wo, active)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            bs.sampled_component = mi.UInt32(0)
            value = self.eval(ctx, si, bs.wo, active)
            return bs, dr.select(bs.pdf > 1e-6, value / dr.maximum(bs.pdf, 1e-6), mi.Color3f(0))

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def traverse(self, callback: Any) -> None:
            pass

        def to_string(self) -> str:
            return f"Formula[{self.formula.__name__}]"

    return Formula
