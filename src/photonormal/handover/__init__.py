"""A result folder and its photographs -> files of other programs."""

from photonormal import relighting

FORMATS = {  # name -> ending; folders have none
    **{name: kind.ending for name, kind in relighting.FORMATS.items()},
    "gltf": ".glb",
    "maps": "",
}
