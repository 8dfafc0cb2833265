"""Files of the page: packed beforehand, and under an address that names their contents, so that a
browser never asks twice for one that it has.

Scripts name each other relative to their own address, and so all of them lie under one digest.
"""

from __future__ import annotations

import gzip
import re
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from threading import Lock

from microvib.reports.moving import SCRIPT

PLOTLY = "plotly.min.js"
FIRST = "app.js"
"""The script that the page begins with."""
FOREVER = "public, max-age=31536000, immutable"
_TYPES = {
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".html": "text/html; charset=utf-8",
}
_IMPORT = re.compile(r'^import [^"]*"\./([\w.]+)";$', re.MULTILINE)


@dataclass(frozen=True)
class Asset:
    """A file of the page."""

    content: bytes
    packed: bytes
    media_type: str
    tag: str
    """Digest of the content, by which a browser asks whether it still has it."""

    @classmethod
    def of(cls, name: str, content: bytes) -> Asset:
        """The file of this name, packed."""
        tag = f'"{sha256(content).hexdigest()[:16]}"'
        return cls(content, gzip.compress(content, 6, mtime=0), _TYPES[Path(name).suffix], tag)


class Assets:
    """All files of the page, read once."""

    def __init__(self) -> None:
        static = Path(str(resources.files("microvib.web"))) / "static"
        self._paths = {path.name: path for path in sorted(static.iterdir())}
        self._paths |= {SCRIPT.name: SCRIPT}
        plotly = _plotly()
        if plotly is not None:
            self._paths[PLOTLY] = plotly
        self._page = self._paths.pop("index.html").read_text(encoding="utf-8")
        self._packed: dict[str, Asset] = {}
        self._packing = Lock()

    @cached_property
    def digest(self) -> str:
        """Digest of all contents, a part of their address."""
        found = sha256(self._page.encode())
        for name, path in self._paths.items():
            found.update(name.encode() + path.read_bytes())
        return found.hexdigest()[:16]

    @cached_property
    def page(self) -> Asset:
        """The page, which names its files by their digest and the scripts that it begins with."""
        text = self._page.replace('"/static/', f'"/static/{self.digest}/')
        links = "\n".join(
            f'<link rel="modulepreload" href="/static/{self.digest}/{name}">'
            for name in self._scripts(FIRST)
        )
        return Asset.of("index.html", text.replace("</head>", f"{links}\n</head>").encode())

    def _scripts(self, first: str) -> list[str]:
        """A script and those that it imports at once, directly or not."""
        found, waiting = [], [first]
        while waiting:
            name = waiting.pop(0)
            if name not in found and name in self._paths:
                found.append(name)
                waiting += _IMPORT.findall(self._paths[name].read_text(encoding="utf-8"))
        return found

    def get(self, name: str) -> Asset | None:
        """A file by its name; None where there is none."""
        path = self._paths.get(name)
        if path is None:
            return None
        with self._packing:
            if name not in self._packed:
                self._packed[name] = Asset.of(name, path.read_bytes())
            return self._packed[name]

    def pack(self) -> None:
        """Read and pack everything, before it is asked for."""
        for name in self._paths:
            self.get(name)
        self.page  # noqa: B018 - which keeps it


def _plotly() -> Path | None:
    """Plotly's script, without importing the package, which takes a second."""
    spec = find_spec("plotly")
    if spec is None or spec.origin is None:
        return None
    return Path(spec.origin).parent / "package_data" / PLOTLY
