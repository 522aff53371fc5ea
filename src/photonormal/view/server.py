"""A page on this machine: 127.0.0.1 only, a token in its address, nothing but what was named."""

from __future__ import annotations

import secrets
import socket
import sys
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from photonormal.types import InputError
from photonormal.view.result import Shown, open_result
from photonormal.view.show import result_page

if TYPE_CHECKING:
    from fastapi import FastAPI

HOST = "127.0.0.1"


def application(token: str) -> FastAPI:
    """An application without pages yet, whose answers are never kept or taken for something else."""
    try:
        from fastapi import FastAPI
    except ModuleNotFoundError:
        raise InputError(
            "`photonormal view` needs FastAPI and uvicorn, which are not here; install them: pip install "
            "'photonormal[view]'. `photonormal export RESULT --page FILE.html` does without."
        ) from None
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @app.middleware("http")
    async def guarded(request, call_next):  # pyright: ignore[reportUnusedFunction]
        from fastapi import Response

        host = request.headers.get("host", "").rsplit(":", 1)[0]
        if host not in (HOST, "localhost") or not secrets.compare_digest(request.url.path.split("/")[1], token):
            return Response(status_code=404)
        answer = await call_next(request)
        answer.headers["Cache-Control"] = "no-store"
        answer.headers["X-Content-Type-Options"] = "nosniff"
        answer.headers["Referrer-Policy"] = "no-referrer"
        answer.headers["Cross-Origin-Resource-Policy"] = "same-origin"
        return answer

    return app


def results_application(shown: Sequence[Shown], token: str) -> FastAPI:
    """The page of some results, and their tiles."""
    app = application(token)
    from fastapi import HTTPException, Response
    from fastapi.responses import HTMLResponse

    page = result_page([s.about for s in shown])

    @app.get(f"/{token}/", response_class=HTMLResponse)
    def whole() -> str:  # pyright: ignore[reportUnusedFunction]
        return page

    @app.get(f"/{token}/tile/{{index}}/{{layer}}/{{level}}/{{x}}/{{y}}")
    def tile(index: int, layer: str, level: int, x: int, y: int) -> Response:  # pyright: ignore[reportUnusedFunction]
        try:
            if index < 0:
                raise IndexError
            return Response(shown[index].tile(layer, level, x, y), media_type="application/octet-stream")
        except InputError as error:  # a photograph that is no longer there
            raise HTTPException(410, str(error)) from None
        except (LookupError, ValueError):
            raise HTTPException(404) from None

    return app


def serve(
    make: Callable[[str], FastAPI], port: int = 0, browser: bool = True, say: Callable[[str], None] = print
) -> None:
    """Serve the application that `make` builds for a token until it is interrupted.

    Parameters
    ----------
    port : 0 for a free one
    browser : open the page; `say` tells its address where none opens, or where none is wanted

    Raises
    ------
    InputError
        If the port is taken.
    """
    token = secrets.token_urlsafe(16)
    app = make(token)
    import uvicorn

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
    say(address)
    if browser and not webbrowser.open(address):
        say("No browser opens from here; open the address above in one on this machine.")
    server.run(sockets=[listening])


def serve_results(
    folders: Sequence[str | Path],
    capture: str | Path | None = None,
    mm_per_px: float | None = None,
    port: int = 0,
    browser: bool = True,
) -> None:
    """Serve the page of result folders; `capture` holds the photographs of the first."""
    if not folders:
        raise InputError("no result was named; give a folder that `photonormal measure` wrote.")
    shown = [open_result(f, capture if k == 0 else None, mm_per_px) for k, f in enumerate(folders)]
    serve(lambda token: results_application(shown, token), port, browser, lambda text: print(text, flush=True))
