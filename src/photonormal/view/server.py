"""A page on this machine: 127.0.0.1 only, a token in its address, nothing but what was named."""

from __future__ import annotations

import secrets
import socket
import sys
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Thread
from typing import Any

from photonormal.export.folder import REPORT
from photonormal.stored import decoded
from photonormal.types import InputError
from photonormal.view.marking import MarkedOutline, Marking, Marks
from photonormal.view.result import ViewedResult, is_result, open_result
from photonormal.view.show import marking_page, result_page

try:
    import uvicorn
    from fastapi import FastAPI, HTTPException, Request, Response
    from fastapi.concurrency import run_in_threadpool
    from fastapi.responses import JSONResponse
except ModuleNotFoundError:
    raise InputError(
        "`photonormal view` needs FastAPI and uvicorn, which are not here; install them: pip install "
        "'photonormal[view]'. `photonormal export RESULT --page FILE.html` does without."
    ) from None

HOST = "127.0.0.1"


def application(token: str) -> FastAPI:
    """An application without pages yet, whose answers are never kept or taken for something else; it says what it
    can't read."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @app.middleware("http")
    async def guarded(request: Request, call_next: Any) -> Response:  # pyright: ignore[reportUnusedFunction]
        host = request.headers.get("host", "").rsplit(":", 1)[0]
        named = request.url.path.split("/")[1]
        if host not in (HOST, "localhost") or not secrets.compare_digest(named.encode(), token.encode()):
            return Response(status_code=404)
        answer = await call_next(request)
        answer.headers["Cache-Control"] = "no-store"
        answer.headers["X-Content-Type-Options"] = "nosniff"
        answer.headers["Referrer-Policy"] = "no-referrer"
        answer.headers["Cross-Origin-Resource-Policy"] = "same-origin"
        return answer

    @app.exception_handler(InputError)
    async def gone(request: Request, error: InputError) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        return JSONResponse({"detail": str(error)}, 410)  # a photograph that is no longer there

    return app


def results_application(shown: Sequence[ViewedResult], token: str) -> FastAPI:
    """The page of some results, and their tiles."""
    app = application(token)
    page = result_page([s.about for s in shown])

    @app.get(f"/{token}/")
    def whole() -> Response:  # pyright: ignore[reportUnusedFunction]
        return Response(page, media_type="text/html")

    @app.get(f"/{token}/tile/{{index}}/{{layer}}/{{level}}/{{x}}/{{y}}")
    def tile(index: int, layer: str, level: int, x: int, y: int) -> Response:  # pyright: ignore[reportUnusedFunction]
        try:
            if index < 0:
                raise IndexError
            return Response(shown[index].tile(layer, level, x, y), media_type="application/octet-stream")
        except InputError:
            raise
        except (LookupError, ValueError):
            raise HTTPException(404) from None

    return app


def serve(make: Callable[[str], FastAPI], port: int = 0, browser: bool = True) -> None:
    """Serve the application that `make` builds for a token until it is interrupted.

    Parameters
    ----------
    port : 0 for a free one
    browser : open the page; its address is printed in either case

    Raises
    ------
    InputError
        If the port is taken.
    """
    token = secrets.token_urlsafe(16)
    app = make(token)
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1) if sys.platform != "win32" else None
    try:
        listening.bind((HOST, port))
        listening.listen()
    except (OSError, OverflowError):
        listening.close()
        raise InputError(f"port {port} is taken or not allowed; choose another --port, or leave it out.") from None
    address = f"http://{HOST}:{listening.getsockname()[1]}/{token}/"
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False))
    with server.capture_signals():  # from the moment that the user can read the address
        print(address, flush=True)
        if browser:  # beside the server: some browsers, as those of a terminal, come back when they are closed
            Thread(target=_open, args=(address,), daemon=True).start()
        server.run(sockets=[listening])


def _open(address: str) -> None:
    if not webbrowser.open(address):
        print("No browser opens from here; open the address above in one on this machine.", flush=True)


def marking_application(marking: Marking, token: str) -> FastAPI:
    """The page that marks photographs; what it sends is checked, what it saves goes into the photographs' folder."""
    app = application(token)
    page = marking_page(marking.about())

    @app.get(f"/{token}/")
    def whole() -> Response:  # pyright: ignore[reportUnusedFunction]
        return Response(page, media_type="text/html")

    @app.get(f"/{token}/picture/{{j}}")
    def picture(j: int) -> Response:  # pyright: ignore[reportUnusedFunction]
        if not 0 <= j < len(marking.names):
            raise HTTPException(404)
        return Response(marking.picture(j), media_type="image/webp")

    @app.get(f"/{token}/mask")
    def mask() -> Response:  # pyright: ignore[reportUnusedFunction]
        return Response(marking.mask_bytes(), media_type="application/octet-stream")

    async def answered(request: Request, kind: Any, act: Callable[[Any], dict[str, Any]]) -> JSONResponse:
        try:
            asked = decoded(await request.body(), kind, "what the page sent", "reload it")
            return JSONResponse(await run_in_threadpool(act, asked))
        except InputError as error:
            return JSONResponse({"problem": str(error)})

    @app.post(f"/{token}/sphere")
    async def sphere(request: Request) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        return await answered(request, MarkedOutline, marking.sphere)

    @app.post(f"/{token}/sphere/found")
    async def found() -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        try:
            return JSONResponse(await run_in_threadpool(marking.sphere, None))
        except InputError as error:
            return JSONResponse({"problem": str(error)})

    @app.post(f"/{token}/save")
    async def save(request: Request) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        return await answered(request, Marks, marking.save)

    return app


def open_pages(
    folders: Sequence[str | Path],
    capture: str | Path | None = None,
    mm_per_px: float | None = None,
    port: int = 0,
    browser: bool = True,
) -> None:
    """Serve the page of result folders, or the one that marks the photographs of a folder; until it is interrupted.

    Parameters
    ----------
    folders : results, or one folder of photographs
    capture : the photographs of the first result, where its report does not find them
    mm_per_px : millimetres that a pixel is wide, where the reports do not say
    port, browser : as for `serve`
    """
    paths = [Path(f) for f in folders]
    if not paths:
        raise InputError("no folder was named; give one that `photonormal measure` wrote, or one of photographs.")
    if len(paths) == 1 and paths[0].is_dir() and not (paths[0] / REPORT).exists() and not is_result(paths[0]):
        marking = Marking(paths[0])
        serve(lambda token: marking_application(marking, token), port, browser)
        return
    shown = [open_result(f, capture if k == 0 else None, mm_per_px) for k, f in enumerate(paths)]
    titles, names = [s.about["title"] for s in shown], [path.resolve().name for path in paths]
    for path, name, s in zip(paths, names, shown, strict=True):
        if titles.count(s.about["title"]) > 1:  # one capture measured in two ways: folders tell them apart
            s.about["title"] += f" ({name if names.count(name) == 1 else path})"
    serve(lambda token: results_application(shown, token), port, browser)
