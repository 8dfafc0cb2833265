"""The documentation site: where it is in the package, and how it gets there from a checkout."""

from __future__ import annotations

from pathlib import Path

import microvib
from microvib.errors import MicrovibError, OutputError
from microvib.io.writing import put_in_place, workspace

PACKAGE = Path(microvib.__file__).parent
SITE = PACKAGE / "site"
SOURCE = PACKAGE.parents[1] / "docs"


def site_index() -> Path:
    """First page of the site; MicrovibError where it was not built into this installation."""
    index = SITE / "index.html"
    if not index.is_file():
        raise MicrovibError(
            "the site is not in this installation; build it in a checkout with: microvib docs --build (its pages can be read"
            " there as plain files, in docs)"
        )
    return index


def build_site() -> None:
    """Build the site from the checkout that this package is installed from, and put it into the package."""
    if not (SOURCE / "conf.py").is_file():
        raise MicrovibError(
            "building needs a checkout of the repository, installed with: pip install -e '.[docs]'; this installation is not one"
        )
    from sphinx.cmd.build import build_main

    doctrees = SOURCE / "_build" / "doctrees"
    try:
        with workspace(PACKAGE, SITE.name) as space:
            new = space / "new"
            if build_main(["-W", "--keep-going", "-q", "-d", str(doctrees), str(SOURCE), str(new)]) != 0:
                raise MicrovibError(
                    "the site was not built, for the reasons above; the one that was there is unchanged"
                )
            put_in_place(new, SITE, space)
    except OSError as error:
        raise OutputError(f"{SITE}: cannot be written: {error.strerror or error}") from None
