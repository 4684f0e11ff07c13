# SPDX-License-Identifier: MIT
"""Which requests the server answers, and how. Every refusal has a name and is counted.

A page of another site can make a browser on this machine connect here. It can't choose
the headers Host and Origin, so both must name this machine. A program has no Origin: it
gets the stream, and so do pages of this machine, or of sites that the user has named.
"""

from __future__ import annotations

import re
from collections.abc import Container
from http import HTTPStatus
from urllib.parse import urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from imud.endpoint import is_loopback
from imud.version import version
from imud.web.files import File

SOCKET = "/live"  # path of the page's WebSocket
STREAM = "/stream"  # of the one for programs

_HOST = re.compile(r"(\[[0-9a-f:]+\]|[\w.-]+)(:\d{1,5})?", re.IGNORECASE | re.ASCII)

# Scripts, styles and connections of this server alone, and no frames around the page.
_POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


def refusal(
    request: Request, origins: Container[str] = ()
) -> tuple[str, HTTPStatus] | None:
    """Why a request is refused: a name for it and the status; None: it is not.
    `origins`: the sites whose pages get the stream.
    """
    host = _single(request.headers, "Host")
    if host is None or not _is_ours(host):
        return "host", HTTPStatus.MISDIRECTED_REQUEST
    if path_of(request) == STREAM:
        strange = [
            origin
            for origin in request.headers.get_all("Origin")
            if origin not in origins and not _is_local_page(origin)
        ]
        return ("origin", HTTPStatus.FORBIDDEN) if strange else None
    origin = _single(request.headers, "Origin")
    is_socket = path_of(request) == SOCKET
    if (origin is not None or is_socket) and origin != f"http://{host}":
        return "origin", HTTPStatus.FORBIDDEN
    return None


def path_of(request: Request) -> str:
    """The path without the query, undecoded: no file's name needs an escape."""
    return urlsplit(request.path).path if request.path.startswith("/") else ""


def text_response(status: HTTPStatus, words: str = "") -> Response:
    """A response of one line of text."""
    body = f"{words or status.phrase}\n".encode()
    return _response(status, "text/plain; charset=utf-8", body, {})


def file_response(request: Request, file: File) -> Response:
    """The file, packed where the browser can unpack it; nothing if it has it."""
    more = {"ETag": file.tag, "Vary": "Accept-Encoding"}
    if file.tag in _all(request.headers, "If-None-Match"):
        return _response(HTTPStatus.NOT_MODIFIED, file.kind, b"", more)
    if "gzip" in _all(request.headers, "Accept-Encoding"):
        more["Content-Encoding"] = "gzip"
        return _response(HTTPStatus.OK, file.kind, file.packed, more)
    return _response(HTTPStatus.OK, file.kind, file.body, more)


def _response(
    status: HTTPStatus, kind: str, body: bytes, more: dict[str, str]
) -> Response:
    headers = Headers(
        {
            "Server": f"imud/{version()}",
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Connection": "close",
            **_HEADERS,
            **more,
        }
    )
    return Response(status.value, status.phrase, headers, body)


def _single(headers: Headers, name: str) -> str | None:
    values = headers.get_all(name)
    return values[0] if len(values) == 1 else None


def _all(headers: Headers, name: str) -> str:
    """All values of a header, which may be repeated."""
    return ", ".join(headers.get_all(name))


def _is_local_page(origin: str) -> bool:
    """Whether a server on this machine served the page that connects."""
    scheme, _, host = origin.partition("://")
    return scheme in ("http", "https") and _is_ours(host)


def _is_ours(host: str) -> bool:
    """Whether it names this machine, on any port: a tunnel may have another."""
    match = _HOST.fullmatch(host)
    return match is not None and is_loopback(match[1].strip("[]").lower())
