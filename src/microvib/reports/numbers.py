"""Numbers as texts in reports and on the terminal; what is not known is left empty."""

from __future__ import annotations

import math


def brief_number(value: float, digits: int = 4) -> str:
    """A figure with at most so many digits; empty if there is none."""
    if math.isfinite(value):
        return f"{value:.{digits}g}"
    return ""


def format_number(value: float, digits: int = 4, scale: float = 1.0) -> str:
    """A figure with so many digits, zeros at its end included; empty if there is none."""
    return f"{value * scale:#.{digits}g}".rstrip(".") if math.isfinite(value) else ""


def window_text(length: float) -> str:
    """The length of a window [s], in ms below a second."""
    if length < 1.0:
        return f"{1e3 * length:g} ms"
    return f"{length:g} s"


def plain_number(value: float, digits: int = 4) -> str:
    """A figure with at most so many digits and, up to a million, without an exponent."""
    return f"{float(f'{value:.{digits}g}'):g}"


def signed(value: float, decimals: int = 2) -> str:
    """A figure with its sign; what rounds to zero is +0."""
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"


def with_error(value: float, error: float) -> str:
    """A value with its standard error: two digits of the error, and as many decimals of the value."""
    if not (math.isfinite(error) and error > 0.0):
        return brief_number(value)
    decimals = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"


def percent(value: float) -> str:
    """A relative difference in per cent, to a tenth of one, or below ten a hundredth; empty if
    there is none.
    """
    if math.isfinite(value):
        return f"{100 * value:+.{1 if abs(value) >= 0.1 else 2}f}"
    return ""


def count_text(n: int, what: str) -> str:
    """A number of things in words."""
    if n == 1:
        return f"{n} {what}"
    return f"{n} {what}s"


def truncate(text: str, most: int) -> str:
    """The text, cut where it is too long for its place."""
    if len(text) <= most:
        return text
    return text[: most - 1].rstrip() + "…"
