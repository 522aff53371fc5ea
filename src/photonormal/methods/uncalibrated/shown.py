"""What lights are found from: the grey levels of a reduced object."""

from __future__ import annotations

from dataclasses import dataclass, replace

from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.inputs.grey import Levels, grey
from photonormal.methods.uncalibrated.reduced import reduced
from photonormal.types import Capture, InputError

SIDE = 128  # pixels of the square that the object is reduced to


@dataclass(frozen=True)
class ShownPixels:
    """`p` pixels of a reduced object in `n` images.

    Parameters
    ----------
    I : (p, n) grey levels, cut where highlights end
    keep : (p, n) bool, samples that are lit
    inside : (h, w) bool, where the pixels lie
    colours : (n, c) mean radiance of each image
    """

    I: Float[Tensor, "p n"]
    keep: Bool[Tensor, "p n"]
    inside: Bool[Tensor, "h w"]
    colours: Float[Tensor, "n c"]

    @classmethod
    def of(cls, capture: Capture) -> ShownPixels:
        """Those of a capture; InputError where none is left of it, as of a strip."""
        images, inside = reduced(capture, SIDE)
        if not inside.any():
            raise InputError(
                f"{capture.name} is so narrow that nothing is left of it when it is reduced to {SIDE} pixels to find "
                "lights; --crop a shorter part of it."
            )
        I = grey(images[None])[0, :, 0][:, inside].T.contiguous()
        levels = Levels.of(I)
        I = levels.cut_(I)
        return cls(I, levels.lit(I), inside, images[:, :, inside].mean(2))

    def over(self, e: Float[Tensor, " n"]) -> ShownPixels:
        """The same divided by the intensities of the lights."""
        return replace(self, I=self.I / e)
