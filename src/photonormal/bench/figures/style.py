"""Colours and lines of all figures: the palette of Okabe and Ito, and cividis, for colour-blind people, too."""

from __future__ import annotations

from typing import Any

from photonormal.types import InputError

try:
    from matplotlib import rc_context as style_context
    from matplotlib.figure import Figure
except ImportError:
    raise InputError("figures need matplotlib; pip install 'photonormal[bench]'.") from None

__all__ = ["COLOURS", "ERRORS", "LINES", "MARKERS", "STYLE", "Figure", "style_context"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#F0E442")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
LINES = ("-", "--", "-.", ":")
ERRORS = "cividis"  # colours of error maps

STYLE: Any = {
    "font.size": 8,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 8,
    "axes.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 7,
    "pdf.fonttype": 42,  # text stays text
    "savefig.facecolor": "white",
}
