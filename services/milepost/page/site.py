"""The page in a browser: NiceGUI serves it; a socket sends each browser what is different, whenever it asks."""

from __future__ import annotations

import asyncio
import html
import re
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from urllib.parse import urlsplit

from fastapi import FastAPI, HTTPException, WebSocket, WebSocketDisconnect
from nicegui import app as pages
from nicegui import ui
from starlette.middleware.trustedhost import TrustedHostMiddleware

from .heard import Heard
from .inject_panel import inject_panel
from .injecting import Injecting
from .viewer import Lines, Viewer

STATIC = Path(__file__).resolve().parent / "static"
NAME = re.compile(r"[a-z0-9][a-z0-9_.-]{0,62}")
LOCAL = ("127.0.0.1", "localhost")
MOST_BROWSERS = 64
TRY_AGAIN_LATER = 1013
# whoever asks faster is answered so often
LEAST_S = 0.05
# speeds are kept also while nobody looks
REFRESH_S = 0.25
ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><rect width="16" height="16" rx="3" fill="#0b5cad"/>'
    '<path d="M2 11h12M8 8 5 4h6z" stroke="#fff" fill="#fff"/></svg>'
)


def site(heard: Heard, lines: Lines, injecting: Injecting, host: str) -> FastAPI:
    """The application; what is `heard` and which trains allow injecting is somebody else's to find out."""
    app = FastAPI(openapi_url=None, lifespan=_refreshing(heard))
    if host in LOCAL:
        # a page from elsewhere could otherwise have a name of its own lead here
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(LOCAL))
    _add_socket(app, heard, lines)

    @ui.page("/", title="Trains")
    def _all_trains() -> None:
        _body("overview")

    @ui.page("/train/{name}", title="Train")
    def _one_train(name: str) -> None:
        if not NAME.fullmatch(name):
            raise HTTPException(404)
        ui.page_title(name)
        _body("train", name)
        if host in LOCAL:  # who is elsewhere may look, and no more
            inject_panel(heard, name, injecting)

    pages.add_static_files("/static", STATIC, max_cache_age=0)
    ui.run_with(
        app,
        favicon=ICON,
        dark=None,
        language="en-GB",
        tailwind=False,
        binding_refresh_interval=None,
        message_history_length=50,
        show_welcome_message=False,
    )
    return app


def _body(name: str, train: str = "") -> None:
    """The page's own part: it stands there before its script runs, and NiceGUI's part comes below it."""
    common, own = ((STATIC / f"{each}.html").read_text(encoding="utf-8") for each in ("common", name))
    own = own.replace('id="train"', f'id="train" data-train="{html.escape(train)}"')
    ui.add_head_html('<link rel="stylesheet" href="/static/page.css">')
    ui.add_body_html(f'<div class="page">{common}{own}</div><script type="module" src="/static/{name}.js"></script>')


def _refreshing(heard: Heard) -> Callable[[FastAPI], AbstractAsyncContextManager[None]]:
    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        async def refresh() -> None:
            while True:
                heard.refresh()
                await asyncio.sleep(REFRESH_S)

        task = asyncio.create_task(refresh())
        yield
        task.cancel()

    return lifespan


def _add_socket(app: FastAPI, heard: Heard, lines: Lines) -> None:
    open_now: set[WebSocket] = set()

    @app.websocket("/live")
    async def _live(socket: WebSocket, train: str = "") -> None:
        origin = socket.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != socket.headers.get("host"):
            await socket.close()
            return
        await socket.accept()
        if len(open_now) >= MOST_BROWSERS:
            await socket.close(TRY_AGAIN_LATER)
            return
        open_now.add(socket)
        viewer = Viewer(heard, lines, train)
        try:
            while True:
                await socket.receive_text()
                await socket.send_json(viewer.frame(time.time_ns()))
                await asyncio.sleep(LEAST_S)
        except WebSocketDisconnect:
            pass
        finally:
            open_now.discard(socket)
