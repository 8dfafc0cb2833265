"""Who may ask: the names that the server goes by, and what shows that a request is its owner's."""

from __future__ import annotations

import ipaddress
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

_LINKED = re.compile(r"/api/runs/[0-9a-f]{16}/files/[a-z.]+")
"""What a link may lead to, which can carry no header."""


def _secret() -> str:
    return secrets.token_urlsafe(24)


@dataclass(frozen=True)
class Access:
    """From where and with what the server may be asked.

    A script shows the token. A browser is given a cookie and a key for it. Scripts cannot read the cookie, but browsers send it to
    every port of a host, so also to servers of other users; the key is in the page's storage, which belongs to this host and port
    alone. Neither opens anything without the other, but that links to files go with the cookie: nobody else knows the id in them.
    """

    names: frozenset[str] = frozenset({"localhost"})
    """Host names that it goes by, besides addresses."""
    remote: bool = False
    cookie: str = "microvib"
    """Name of the cookie; it has the port in it, because servers at other ports of the host have their own."""
    token: str = field(default_factory=_secret, repr=False)
    session: str = field(default_factory=_secret, repr=False)
    """Value of the cookie."""
    key: str = field(default_factory=_secret, repr=False)

    def known(self, host: str) -> bool:
        """Whether the server goes by this Host: names can be made to lead here by others, addresses cannot."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self.names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self.remote or address.is_loopback

    def may(self, path: str, headers: Mapping[str, str]) -> bool:
        """Whether a request shows that it is the owner's."""
        if self._bears(headers):
            return True
        whole = _LINKED.fullmatch(path) is not None or _same(headers.get("x-microvib-key", ""), self.key)
        return whole and self._has_cookie(headers)

    def greets(self, headers: Mapping[str, str]) -> bool:
        """Whether a request comes from somebody who has been let in, which opens nothing yet."""
        return self._bears(headers) or self._has_cookie(headers)

    def opens(self, token: str) -> bool:
        """Whether this is the token."""
        return _same(token, self.token)

    def _bears(self, headers: Mapping[str, str]) -> bool:
        return self.opens(headers.get("authorization", "").removeprefix("Bearer "))

    def _has_cookie(self, headers: Mapping[str, str]) -> bool:
        # By hand: http.cookies gives up at the first odd cookie, and other servers of the host have theirs in the same header.
        pairs = (part.strip().partition("=") for part in headers.get("cookie", "").split(";"))
        return any(name == self.cookie and _same(value, self.session) for name, _, value in pairs)


def _same(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())
