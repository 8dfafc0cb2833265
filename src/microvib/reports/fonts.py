"""Fonts for characters that the fonts of the package lack, such as Chinese or Japanese: those of
the system, if it has any.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_FIRST_UNCERTAIN_CODE_POINT = 0x0300
"""Below, the fonts of the package have everything."""


@dataclass(frozen=True)
class Fallback:
    """Fonts to look in after those of the package, by family and folder, and the characters that
    none of them has.
    """

    families: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()
    unknown: frozenset[str] = frozenset()

    @property
    def sentence(self) -> str:
        """Sentence on characters that cannot be printed; empty if all can be."""
        if not self.unknown:
            return ""
        codes = ", ".join(f"U+{ord(c):04X}" for c in sorted(self.unknown)[:6])
        if len(self.unknown) > 6:
            more = f" and {len(self.unknown) - 6} more"
        else:
            more = ""
        return (
            f"No font of the machine that set this document has the characters {codes}{more}: they"
            " are missing or print as boxes"
            " here, and are whole in report.html."
        )


def package_fonts() -> Path:
    """Folder of the fonts that come with Matplotlib."""
    import matplotlib

    return Path(matplotlib.get_data_path()) / "fonts" / "ttf"


def fallback_for(texts: Iterable[str]) -> Fallback:
    """Fonts of the system for the characters of ``texts`` that those of the package lack."""
    rare = {
        c
        for text in texts
        for c in text
        if ord(c) >= _FIRST_UNCERTAIN_CODE_POINT and c.isprintable()
    }
    missing = frozenset(
        c for c in rare if ord(c) not in _characters(str(package_fonts() / "DejaVuSans.ttf"))
    )
    if missing:
        return _found(missing)
    return Fallback()


@cache
def _found(missing: frozenset[str]) -> Fallback:
    """The fonts of the system that have most of what is missing, one after the other."""
    from matplotlib import font_manager
    from matplotlib.ft2font import FT2Font

    has = {
        path: missing & set(map(chr, _characters(path)))
        for path in sorted(font_manager.findSystemFonts())
    }
    families: list[str] = []
    folders: list[str] = []
    while missing and has:
        best = max(has, key=lambda path: len(has[path] & missing))
        if not has[best] & missing:
            break
        missing -= has.pop(best)
        families.append(FT2Font(best).family_name)
        font_manager.fontManager.addfont(best)  # pictures take it too
        folders.append(str(Path(best).parent))
    return Fallback(tuple(families), tuple(dict.fromkeys(folders)), missing)


@cache
def _characters(path: str) -> frozenset[int]:
    """Code points that a font has; none where it cannot be read."""
    from matplotlib.ft2font import FT2Font

    try:
        return frozenset(FT2Font(path).get_charmap())
    except (RuntimeError, OSError):
        return frozenset()
