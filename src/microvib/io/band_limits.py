"""Limits on the peaks of bands, from a CSV file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from microvib.errors import MicrovibError
from microvib.io.tables import dict_rows, parse_finite, text_dict_rows

_LIMITS = {
    "limit_n_m": (1.0, "N*m"),
    "limit_mn_m": (1e-3, "N*m"),
    "limit_n": (1.0, "N"),
    "limit_mn": (1e-3, "N"),
    "limit_m_s2": (1.0, "m/s^2"),
    "limit_mm_s2": (1e-3, "m/s^2"),
    "limit_g": (1.0, "g"),
    "limit_mg": (1e-3, "g"),
}
"""Columns of limits: their unit in the one that channels are kept in, and that."""
_NEEDED = ("low_hz", "high_hz")
_COLUMNS = (*_NEEDED, *_LIMITS, "channel")
_WHAT = "bands with limits"


@dataclass(frozen=True)
class BandLimit:
    """Largest magnitude that the time history of a channel may have in a band.

    Parameters
    ----------
    low, high : float
        Ends of the band [Hz].
    limit : float
        The magnitude, in ``unit``.
    unit : str
        ``N``, ``N*m``, ``m/s^2`` or ``g``.
    channel : str
        Channel for which it holds; empty for the one that is analysed.
    """

    low: float
    high: float
    limit: float
    unit: str
    channel: str = ""


def read_band_limits(path: Path | str) -> tuple[BandLimit, ...]:
    """Read bands and their limits.

    Parameters
    ----------
    path : str or path
        A CSV file with ``low_hz``, ``high_hz``, a limit in the unit of its column, such as
        ``limit_mn_m``, and perhaps ``channel``.

    Returns
    -------
    tuple of BandLimit
        The bands, in the order of the rows.

    Raises
    ------
    MicrovibError
        Where the file cannot be read, or a row is wrong: says which.
    """
    rows = dict_rows(Path(path), _COLUMNS, what=_WHAT, needed=_NEEDED)
    return tuple(_limit(f"{path}, row {k}", row) for k, row in enumerate(rows, 2))


def band_limits_from_text(text: str, name: str = "bands") -> tuple[BandLimit, ...]:
    """As ``read_band_limits``, of the contents of a file that its owner calls ``name``."""
    rows = text_dict_rows(text, name, _COLUMNS, what=_WHAT, needed=_NEEDED)
    return tuple(_limit(f"{name}, row {k}", row) for k, row in enumerate(rows, 2))


def _limit(where: str, row: dict[str, str]) -> BandLimit:
    low = parse_finite(f"{where}: low_hz", row["low_hz"])
    high = parse_finite(f"{where}: high_hz", row["high_hz"])
    if not 0.0 <= low < high:
        raise MicrovibError(
            f"{where}: a band from {low:g} to {high:g} Hz is not allowed; low_hz must be at least 0"
            " and below high_hz"
        )
    given = [name for name in _LIMITS if (row.get(name) or "").strip()]
    if len(given) != 1:
        raise MicrovibError(
            f"{where}: has {len(given)} limits; one is expected, in a column {', '.join(_LIMITS)}"
        )
    size, unit = _LIMITS[given[0]]
    limit = parse_finite(f"{where}: {given[0]}", row[given[0]])
    if not limit > 0.0:
        raise MicrovibError(f"{where}: {given[0]} {limit:g} is not allowed; more than 0")
    return BandLimit(low, high, size * limit, unit, (row.get("channel") or "").strip())
