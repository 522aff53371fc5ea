"""Benchmarks: predict once and store, then tables, figures and a report from disk. Nothing heavy loads on import."""

from __future__ import annotations

from typing import Any


def bench(benchmark: str, root: Any, out: Any, **options: Any) -> Any:
    """Predict normals of a benchmark's objects and store them; see `photonormal.bench.predict.bench`."""
    from photonormal.bench.predict import bench as run

    return run(benchmark, root, out, **options)
