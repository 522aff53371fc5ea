"""Photographs and normals -> what the surface is made of: albedo without highlights, roughness, metalness."""

from photonormal.materials.maps import materials_of

__all__ = ["materials_of"]
