"""Who may open the page."""

import hmac
import ipaddress
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import parse_qs, urlsplit

_LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True)
class Answer:
    """What a request gets instead of the page.

    Attributes:
        status: of HTTP.
        headers: further headers of the answer.
        text: its body.
    """

    status: HTTPStatus
    headers: tuple[tuple[str, str], ...] = ()
    text: str = ""


@dataclass(frozen=True)
class Guard:
    """Lets in who is on this host or knows the token, and no other site's scripts.

    Attributes:
        token: empty on a loopback address: whoever is on this host may look.
    """

    token: str = ""

    def refusal(self, target: str, headers: dict[str, str], cookie: str) -> Answer | None:
        """None for a request that may pass.

        Browsers let any site open a WebSocket to any host, so the page that opens it must be
        ours (RFC 6455, 10.2), and without a token the host must be named as on this machine,
        or a site whose name is made to mean 127.0.0.1 would count as ours.

        Args:
            target: path and query.
            headers: names in lower case.
            cookie: name of the cookie that holds the token.
        """
        host = headers.get("host", "")
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return Answer(HTTPStatus.FORBIDDEN, text="another site may not use this page\n")
        if not self.token:
            if (urlsplit(f"//{host}").hostname or "") in _LOCAL_NAMES:
                return None
            return Answer(HTTPStatus.FORBIDDEN, text="open this page as http://localhost\n")
        given = parse_qs(urlsplit(target).query).get("token", [""])[0]
        if given and self._is_token(given):
            attributes = "Path=/; HttpOnly; SameSite=Strict"
            keep = ("Set-Cookie", f"{cookie}={given}; {attributes}")
            return Answer(HTTPStatus.SEE_OTHER, (("Location", "/"), keep))
        if self._is_token(_cookies(headers.get("cookie", "")).get(cookie, "")):
            return None
        text = "the address of this page ends in ?token=..., as the viewer has printed it\n"
        return Answer(HTTPStatus.UNAUTHORIZED, text=text)

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.token.encode())


def _cookies(header: str) -> dict[str, str]:
    pairs = (part.strip().partition("=") for part in header.split(";"))
    return {name: value for name, _, value in pairs}


def is_loopback(host: str) -> bool:
    """Whether only this host can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
