"""Photographs -> functions of the light, pixel by pixel, in the files that viewers of RTI open."""

from functools import partial

from photonormal.relighting.bases import Basis, hsh, ptm

FORMATS: dict[str, tuple[str, Basis]] = {  # name -> ending of the file, basis
    "ptm": (".ptm", ptm),
    "ptm-rgb": (".ptm", ptm),
    "hsh": (".rti", partial(hsh, terms=9)),
    "hsh16": (".rti", partial(hsh, terms=16)),
}
