"""Pages that hold all they need, text, style, script and data, and may load nothing from elsewhere."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

WEB = files("photonormal.view") / "web"


def read(name: str) -> str:
    """A file of the page that comes with the package."""
    return (WEB / name).read_text(encoding="utf-8")


def document(
    title: str,
    body: str,
    styles: Sequence[str],
    scripts: Sequence[str],
    data: Any,
    served: bool = False,
    beside: bool = False,
) -> bytes:
    """An HTML page, in UTF-8; names of files may be no text, and show a question mark where they aren't.

    Its policy lets exactly this style and this script act and, if `served`, lets the script ask the program that serves
    it; nothing else is loaded. The data stands once, as JSON without `<`, `>` and `&`, so that no text in it can end
    the block.

    Parameters
    ----------
    title : text
    body : HTML, in which names are escaped
    styles, scripts : their texts, in order; the scripts share one scope
    data : values of JSON, found by the script in the element `data`
    served : parts of the data are asked for from where the page came from
    beside : pictures that lie beside the page, or below its folder, are shown
    """
    style, script = "\n".join(styles), '"use strict";\n' + "\n".join(scripts)
    policy = (
        "default-src 'none'; img-src data:"
        + " 'self' file:" * beside
        + f"; style-src '{_digest(style)}'; script-src '{_digest(script)}'; "
        + "connect-src 'self'; " * served
        + "base-uri 'none'; form-action 'none'"
    )
    block = json.dumps(data, separators=(",", ":"))
    for character in "<>&":
        block = block.replace(character, f"\\u{ord(character):04x}")
    icon = '<link rel="icon" href="data:,">\n' * served  # or the browser asks for one
    whole = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{icon}<title>{escape(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n{body}\n"
        f'<script type="application/json" id="data">{block}</script>\n<script>{script}</script>\n</body>\n</html>\n'
    )
    return whole.encode("utf-8", "replace")


def _digest(text: str) -> str:
    """How a policy names what may run."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def ramp() -> str:
    """The 256 colours of cividis, RGB bytes in base64."""
    import cv2
    import numpy as np

    colours = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_CIVIDIS)[:, 0, ::-1]
    return base64.b64encode(colours.tobytes()).decode()
