"""Who may ask the local server, and how large and of what kind a request may be."""

import json
from collections.abc import Mapping
from secrets import compare_digest
from typing import Any

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_BYTES = 100_000  # of a request
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",  # the address is the key
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Answers only requests that have the token, and that name this host: no other site's name can lead here."""

    def __init__(self, inside: ASGIApp, token: str, host: str) -> None:
        self.inside, self.token, self.host = inside, token.encode(), host.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.inside(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        if not compare_digest(Headers(scope=scope).get("host", "").encode(), self.host):
            await PlainTextResponse("wrong host", 421)(scope, receive, send)
            return
        if not compare_digest(f"{scope['path']}/".split("/")[1].encode(), self.token):
            await PlainTextResponse("not found", 404)(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"], *((key.lower().encode(), value.encode()) for key, value in HEADERS.items())
                ]  # fmt: skip
            await send(message)

        await self.inside(scope, receive, with_headers)


async def posted_setting(request: Request) -> Mapping[str, Any]:
    """The JSON of a request of a size that a page would send."""
    if request.headers.get("content-type") != "application/json":  # which no other site may send unasked
        raise HTTPException(415, "send application/json")
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MOST_BYTES:
            raise HTTPException(413, f"a setting has at most {MOST_BYTES} bytes")
    try:
        data = json.loads(body)
    except (ValueError, RecursionError):
        raise HTTPException(400, "the setting is not JSON") from None
    if not isinstance(data, dict):
        raise HTTPException(400, "the setting is not a table")
    return data
