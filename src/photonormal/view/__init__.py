"""Wing: a page to relight, turn, measure and compare results, served on this machine or written as one file."""

from photonormal.view.show import export_page

__all__ = ["export_page"]
