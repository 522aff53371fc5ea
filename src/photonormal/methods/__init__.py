"""Capture -> Normals. A method is a frozen dataclass (`photonormal.methods.contract`) and one line of METHODS."""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING, Any

from photonormal.lookup import lookup
from photonormal.options import check_fields
from photonormal.types import Capture, InputError, Normals, as_capture, no_such

if TYPE_CHECKING:
    from photonormal.methods.contract import Method

METHODS = {  # name -> "module:Class", imported only when asked for
    "normalnet": "photonormal.methods.learned.normalnet:NormalNetMethod",
    "lambertian-prior": "photonormal.methods.learned.lambertian_prior:LambertianPrior",
    "psfcn": "photonormal.methods.learned.psfcn:PSFCN",
    "psfcn-normalised": "photonormal.methods.learned.psfcn:PSFCNNormalised",
    "gps-net": "photonormal.methods.learned.gpsnet:GPSNetMethod",
    "dr-psn": "photonormal.methods.learned.drpsn:DRPSN",
    "attention-psn": "photonormal.methods.learned.attentionpsn:AttentionPSN",
    "cnn-ps": "photonormal.methods.learned.cnnps:CNNPS",
    "spline-net": "photonormal.methods.learned.splinenet:SPLINENetMethod",
    "lmps": "photonormal.methods.learned.lmps:LMPS",
    "dpsn": "photonormal.methods.learned.dpsn:DPSN",
    "sdps": "photonormal.methods.learned.sdps:SDPS",
    "irps": "photonormal.methods.learned.irps:IRPS",
    "woodham": "photonormal.methods.classical.woodham:Woodham",
    "trimmed": "photonormal.methods.classical.trimmed:Trimmed",
    "l1": "photonormal.methods.classical.l1:L1",
    "sbl": "photonormal.methods.classical.sbl:SBL",
    "rpca": "photonormal.methods.classical.rpca:RPCA",
    "median": "photonormal.methods.classical.median:Median",
    "ransac": "photonormal.methods.classical.ransac:Ransac",
    "table": "photonormal.methods.classical.table:DiscreteTable",
    "ward": "photonormal.methods.classical.ward:Ward",
    "consensus": "photonormal.methods.classical.consensus:Consensus",
    "monotonic": "photonormal.methods.classical.monotonic:Monotonic",
    "bipolynomial": "photonormal.methods.classical.bipolynomial:Bipolynomial",
    "bivariate": "photonormal.methods.classical.bivariate:Bivariate",
}

DEFAULT = "normalnet"
KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}  # of options given as text


def method_class(name: str) -> type:
    """The class of a method; its fields are the method's options."""
    if not isinstance(name, str):
        raise InputError(
            f"the method is {type(name).__name__} but a name is needed; choose from {', '.join(METHODS)}, or make "
            'one of your own known: METHODS["mine"] = "mine:Mine".'
        )
    if name not in METHODS:
        if name.endswith(".safetensors"):
            raise InputError(f"{name} holds weights but a method is needed; give both, such as psfcn:weights={name}.")
        raise no_such("method", name, METHODS)
    return lookup(METHODS[name])


def parse(text: str) -> tuple[str, dict[str, Any]]:
    """Name and options of ``method`` or ``method:option=value:...``; values get the types of the defaults."""
    method, *settings = re.split(r":(?=\w+=)", text)
    texts = dict(setting.split("=", 1) for setting in settings)
    fields = _fields(method, texts)
    return method, {name: _value(method, name, text, fields[name].default) for name, text in texts.items()}


def _fields(method: str, options: dict[str, Any]) -> dict[str, Any]:
    """The fields of a method, or InputError where it lacks one of the options."""
    known = {field.name: field for field in dataclasses.fields(method_class(method))}
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise InputError(f"{method} has no option {unknown[0]!r}; it has {', '.join(known) or 'none'}.")
    return known


def _value(method: str, name: str, text: str, default: Any) -> Any:
    """A value of the default's type."""
    kind = type(default)
    if kind not in KINDS:
        raise InputError(f"{method} can't be given {name} as text; set it from Python.")
    try:
        return {"true": True, "1": True, "false": False, "0": False}[text.lower()] if kind is bool else kind(text)
    except (ValueError, KeyError):
        raise InputError(f"{method} has {name}={default!r} but {text!r} came; give {KINDS[kind]}.") from None


def configure(method: str, **options: Any) -> Method:
    """A method with its options set; InputError names what exists where the method or an option does not.

    It also names an option whose value makes no sense, and what is needed.
    """
    _fields(method, options)
    configured = method_class(method)(**options)
    check_fields(configured, lambda name: f"{method} with {name}")
    return configured


def name_of(method: Method) -> str:
    """A method's key in METHODS; "" where it is not there."""
    place = f"{type(method).__module__}:{type(method).__qualname__}"
    return next((name for name, known in METHODS.items() if known == place), "")


def options_of(method: Method) -> dict[str, Any]:
    """A method's options in JSON's kinds of values."""
    return _plain(dataclasses.asdict(method))  # type: ignore[call-overload]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    return value if isinstance(value, (int, float, str, bool, type(None))) else str(value)


def solve(capture: Capture, method: str = DEFAULT, device: str = "auto", **options: Any) -> Normals:
    """Normals of a capture.

    Parameters
    ----------
    capture : photographs, mask and light directions
    method : networks: normalnet, lambertian-prior, psfcn, psfcn-normalised, gps-net, dr-psn, attention-psn, cnn-ps,
        lmps, spline-net, dpsn, and sdps, which finds the lights; irps, which learns on the object, for minutes;
        classical: woodham, trimmed, l1, sbl, rpca, median, ransac, table, ward, consensus, monotonic, bipolynomial,
        bivariate
    device : "auto", "cpu", "cuda" or any torch device
    options : the method's fields, by name

    Returns
    -------
    Normals, with how far each is expected to be off where that is known (`photonormal.methods.expected`).

    Raises
    ------
    InputError
        If the method or an option does not exist, or the capture can't be solved by it.
    """
    solver = configure(method, **options)
    capture = as_capture(capture)
    from photonormal.methods.engine import on_mask, run, with_lights
    from photonormal.methods.engine.device import torch_device
    from photonormal.methods.expected import with_expected_error

    where = torch_device(device)
    found = run(solver, capture, where)
    normals, lit = on_mask(found, capture), with_lights(capture, found)
    return normals if lit.lights is None else with_expected_error(normals, found.told_deg, lit, solver, where)
