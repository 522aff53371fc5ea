"""Photographs -> functions of the light, pixel by pixel, in the files that viewers of RTI open."""

from functools import partial
from typing import NamedTuple

from photonormal.relighting.bases import Basis, hsh, ptm


class Format(NamedTuple):
    """The ending of a format's file, none where it is a folder, and the basis of its fit."""

    ending: str
    basis: Basis


FORMATS = {
    "ptm": Format(".ptm", ptm),
    "ptm-rgb": Format(".ptm", ptm),
    "hsh": Format(".rti", partial(hsh, terms=9)),
    "hsh16": Format(".rti", partial(hsh, terms=16)),
    "relight": Format("", ptm),
    "relight-hsh": Format("", partial(hsh, terms=9)),
    "openlime": Format("", ptm),
    "openlime-hsh": Format("", partial(hsh, terms=9)),
}
