"""A result folder and its photographs -> files of other programs."""

from photonormal import relighting

FORMATS = {name: kind.ending for name, kind in relighting.FORMATS.items()}  # name -> ending; folders have none
