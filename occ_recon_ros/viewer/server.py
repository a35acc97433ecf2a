"""A viser server that lets in only whom it should."""

import io
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from .guard import Guard


class _Unshared(viser.ViserServer):
    """Never asks a host elsewhere to pass the page on, whoever wants it."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        return None


def start_server(host: str, port: int, guard: Guard) -> viser.ViserServer:
    """Serve on the port, or the next that is free (0: any).

    Raises:
        ValueError: the host has no such address.
    """
    try:
        with socket.create_server((host, 0)):
            pass
    except OSError as error:
        raise ValueError(f"host: cannot listen on '{host}': {error.strerror or error}") from None
    with _guarded(guard) as used, redirect_stdout(io.StringIO()):
        server = _Unshared(host=host, port=port, label="occ-recon", verbose=False)
    if not used:
        server.stop()
        raise RuntimeError("this version of viser serves its page in another way: no guard")
    return server


@contextmanager
def _guarded(guard: Guard) -> Iterator[list[bool]]:
    """Servers of websockets that are started in this block ask the guard first."""
    plain = websockets.asyncio.server.serve
    used: list[bool] = []

    def serve(handler: Any, host: Any, port: Any, *, process_request: Any, **more: Any) -> Any:
        used.append(True)
        check = _checked(guard, process_request)
        return plain(handler, host, port, process_request=check, **more)

    websockets.asyncio.server.serve = serve
    try:
        yield used
    finally:
        websockets.asyncio.server.serve = plain


def _checked(guard: Guard, serve_page: Callable[[Any, Request], Any]) -> Callable[..., Any]:
    def process(connection: Any, request: Request) -> Any:
        headers = {name.lower(): value for name, value in request.headers.raw_items()}
        port = connection.transport.get_extra_info("sockname")[1]
        refusal = guard.refusal(request.path, headers, f"occ_recon_{port}")
        if refusal is None:
            return serve_page(connection, request)
        body = refusal.text.encode()
        more = [("Content-Type", "text/plain; charset=utf-8"), ("Content-Length", str(len(body)))]
        answer = Headers([*refusal.headers, *more])
        return Response(refusal.status.value, refusal.status.phrase, answer, body)

    return process
