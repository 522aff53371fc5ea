"""Photographs of a mirror sphere -> light directions and positions."""
