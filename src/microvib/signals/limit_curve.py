"""Limits over frequency: the largest amplitude that a line may have, and the strictest of it over an
interval.

A curve is straight between its points on logarithmic scales. Two points at one frequency are a step.
Beyond its first and last point nothing is limited. One number in one band is the flat curve.

No verdict may depend on where a notch falls between two frequencies that were looked at. Whatever is
known to within an interval of frequency is therefore asked about over all of it: ``strictest`` is the
least that the curve allows there, ``most_lenient`` the most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from microvib.errors import OptionError
from microvib.model.rigid import COMPONENTS
from microvib.units import Band, GivenQuantity, Si, band, quantity, within_band

EVERYWHERE = Si(0.0), Si(math.inf)
"""The band of all frequencies [Hz]."""
_ROUNDING = 1e-9
"""Relative width of an interval about a single frequency."""
MOST_POINTS = 10_000


@dataclass(frozen=True)
class LimitCurve:
    """Largest amplitude, 0-to-peak, over frequency.

    Parameters
    ----------
    frequency : tuple of float
        Frequencies of the points [Hz], (n,), never falling; the same one twice is a step.
    amplitude : tuple of float
        Largest amplitudes there [N m], or [N] of a force, (n,), above 0.

    Raises
    ------
    OptionError
        For fewer than two points, frequencies that fall, more than two points at one frequency, or
        amplitudes that are not above 0 or, unless all are infinite, not finite.
    """

    frequency: tuple[float, ...]
    amplitude: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency", tuple(map(float, self.frequency)))
        object.__setattr__(self, "amplitude", tuple(map(float, self.amplitude)))
        _check_points(self.frequency, self.amplitude)

    @classmethod
    def flat(cls, amplitude: float, low: float = 0.0, high: float = math.inf) -> LimitCurve:
        """One amplitude between two frequencies [Hz]."""
        return cls((low, high), (amplitude, amplitude))

    @property
    def low(self) -> float:
        """Frequency [Hz] of its first point."""
        return self.frequency[0]

    @property
    def high(self) -> float:
        """Frequency [Hz] of its last point; infinite where it holds at all higher ones."""
        return self.frequency[-1]

    @cached_property
    def is_flat(self) -> bool:
        """Whether it is one amplitude."""
        return self.amplitude.count(self.amplitude[0]) == len(self.amplitude)

    @cached_property
    def least(self) -> float:
        """The least amplitude of all."""
        return min(self.amplitude)

    @property
    def most(self) -> float:
        """The largest amplitude of all."""
        return max(self.amplitude)

    def holds(self, frequency: Any, tolerance: Any = 0.0) -> Any:
        """Whether frequencies [Hz], known to within a ``tolerance`` [Hz], may lie in its range, whose
        ends belong to it; also of arrays.
        """
        return within_band(frequency, self.low, self.high, tolerance)

    def strictest(self, low: Any, high: Any) -> Any:
        """The least amplitude allowed within intervals of frequency.

        Parameters
        ----------
        low, high : float or ndarray
            Ends of the intervals [Hz], which belong to them, (m,).

        Returns
        -------
        float or ndarray
            Least amplitudes, (m,); infinite where nothing is limited in the interval.
        """
        return self._extreme(low, high, lenient=False)

    def most_lenient(self, low: Any, high: Any) -> Any:
        """As ``strictest``, the most that is allowed in the limited part of each interval."""
        return self._extreme(low, high, lenient=True)

    def at(self, frequency: Any) -> Any:
        """The amplitude allowed at frequencies [Hz], the lesser at a step; infinite where nothing is
        limited.
        """
        f = np.asarray(frequency, dtype=float)
        flat = f.ravel()
        slack = _ROUNDING * np.abs(flat)
        inside = (flat >= self.low - slack) & (flat <= self.high + slack)
        place = np.clip(flat[inside], self.low, self.high)
        found = np.full(flat.size, math.inf)
        found[inside] = self._from_left(place)
        if self._has_steps:
            found[inside] = np.minimum(found[inside], self._from_right(place))
        if f.shape:
            return found.reshape(f.shape)
        return float(found[0])

    @cached_property
    def _has_steps(self) -> bool:
        return len(set(self.frequency)) < len(self.frequency)

    def within(self, low: float, high: float) -> LimitCurve | None:
        """Its part between two frequencies [Hz]; None where it has none there."""
        first, last = max(self.low, low), min(self.high, high)
        if not first < last:
            return None
        if (first, last) == (self.low, self.high):
            return self
        inside = [
            (f, a) for f, a in zip(self.frequency, self.amplitude, strict=True) if first < f < last
        ]
        ends = self._from_right(np.array([first])), self._from_left(np.array([last]))
        points = [(first, float(ends[0][0])), *inside, (last, float(ends[1][0]))]
        return LimitCurve(*zip(*points, strict=True))

    def allows_all_of(self, other: LimitCurve) -> bool:
        """Whether whatever keeps the ``other`` keeps this one: the other holds wherever this does, and
        allows no more.
        """
        if other.low > self.low or other.high < self.high:
            return False
        f = np.unique([*self.frequency, *other.frequency])
        f = f[(f >= self.low) & (f <= self.high)]
        left, right = f[f > self.low], f[f < self.high]
        return bool(
            np.all(other._from_left(left) <= self._from_left(left) * (1.0 + _ROUNDING))
            and np.all(other._from_right(right) <= self._from_right(right) * (1.0 + _ROUNDING))
        )

    def _extreme(self, low: Any, high: Any, *, lenient: bool) -> Any:
        if self.is_flat:
            limited = (np.asarray(low) <= self.high) & (np.asarray(high) >= self.low)
            one = np.where(limited, self.amplitude[0], math.inf)
            return one if one.shape else float(one)
        first, last = np.broadcast_arrays(
            np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        )
        shape = first.shape
        first, last = first.ravel(), last.ravel()
        f = self._points[0]
        outside = ~((first <= self.high) & (last >= self.low))
        first, last = np.clip(first, self.low, self.high), np.clip(last, self.low, self.high)
        pick = np.maximum if lenient else np.minimum
        found = pick(self._from_left(first), self._from_left(last))
        begin, end = np.searchsorted(f, first, "left"), np.searchsorted(f, last, "right")
        some = end > begin
        level = np.zeros(begin.size, dtype=int)
        level[some] = np.log2(end[some] - begin[some]).astype(int)
        for k, table in enumerate(self._tables(lenient)):
            here = np.flatnonzero(some & (level == k))
            of_points = pick(table[begin[here]], table[end[here] - 2**k])
            found[here] = pick(found[here], of_points)
        found[outside] = math.inf
        if shape:
            return found.reshape(shape)
        return float(found[0])

    def _tables(self, lenient: bool) -> list[np.ndarray]:
        """Extremes of 1, 2, 4 ... consecutive points: two of them cover any range of points."""
        return self._largest if lenient else self._smallest

    @cached_property
    def _points(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.frequency), np.array(self.amplitude)

    @cached_property
    def _smallest(self) -> list[np.ndarray]:
        return _range_extremes(np.array(self.amplitude), np.minimum)

    @cached_property
    def _largest(self) -> list[np.ndarray]:
        return _range_extremes(np.array(self.amplitude), np.maximum)

    def _from_left(self, f: np.ndarray) -> np.ndarray:
        """Amplitudes at frequencies (m,) [Hz] within the range; at a step, that before it."""
        return self._on_segment(f, np.searchsorted(self._points[0], f, "left"))

    def _from_right(self, f: np.ndarray) -> np.ndarray:
        return self._on_segment(f, np.searchsorted(self._points[0], f, "right"))

    def _on_segment(self, f: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """Amplitudes at ``f`` (m,) [Hz] on the segments that end in the points ``stop`` (m,)."""
        points, sizes = self._points
        stop = np.clip(stop, 1, points.size - 1)
        f0, f1, a0, a1 = points[stop - 1], points[stop], sizes[stop - 1], sizes[stop]
        sloped = (a0 != a1) & (f0 != f1)
        found = np.where(f <= f0, a0, a1)
        part = np.log(f[sloped] / f0[sloped]) / np.log(f1[sloped] / f0[sloped])
        part = np.clip(part, 0.0, 1.0)
        found[sloped] = a0[sloped] * (a1[sloped] / a0[sloped]) ** part
        return np.asarray(found)


def _range_extremes(values: np.ndarray, pick: Any) -> list[np.ndarray]:
    tables = [values]
    while 2 ** len(tables) <= values.size:
        last, reach = tables[-1], 2 ** (len(tables) - 1)
        tables.append(pick(last[:-reach], last[reach:]))
    return tables


def _check_points(frequency: Sequence[float], amplitude: Sequence[float]) -> None:
    """OptionError unless these are points of a curve."""
    if not 2 <= len(frequency) <= MOST_POINTS or len(frequency) != len(amplitude):
        raise OptionError(
            "limit", f"is no curve over frequency; 2 to {MOST_POINTS} points are expected"
        )
    _check_amplitudes(frequency, amplitude)
    _check_frequencies(frequency)
    for (f, a), (g, b) in pairwise(zip(frequency, amplitude, strict=True)):
        if a != b and (not f > 0.0 or not math.isfinite(g)):
            raise OptionError(
                "limit",
                f"changes between {f:g} Hz and {g:g} Hz; frequencies above 0 that are finite are"
                " expected",
            )
        if (f, a) == (g, b):
            raise OptionError("limit", f"has the point {f:g} Hz twice; leave one of them out")


def _check_amplitudes(frequency: Sequence[float], amplitude: Sequence[float]) -> None:
    """OptionError unless all are above 0, and all are finite or none is."""
    unlimited = set(amplitude) == {math.inf}
    for f, a in zip(frequency, amplitude, strict=True):
        if not a > 0.0 or (math.isinf(a) and not unlimited):
            raise OptionError("limit", f"allows {a:g} at {f:g} Hz; a number above 0 is expected")


def _check_frequencies(frequency: Sequence[float]) -> None:
    """OptionError unless they never fall, from 0 or more, and no more than two are alike, which are
    neither the first nor the last.
    """
    for f, g in pairwise(frequency):
        if not f <= g:
            raise OptionError(
                "limit",
                f"goes from {f:g} Hz to {g:g} Hz; frequencies that never fall are expected",
            )
    for f, g in zip(frequency, frequency[2:], strict=False):
        if f == g:
            raise OptionError(
                "limit", f"has more than two points at {f:g} Hz; a step is two of them"
            )
    if frequency[0] < 0.0:
        raise OptionError("limit", f"begins at {frequency[0]:g} Hz; frequencies are 0 or more")
    if frequency[0] == frequency[1] or frequency[-1] == frequency[-2]:
        raise OptionError(
            "limit", "begins or ends with a step; its first and last frequency stand once"
        )


_LARGEST = 1e5
"""Limit [N m], or [N] of a force, above which its unit is taken for a slip: no drive of an array makes as
much.
"""


@dataclass(frozen=True, init=False)
class Limit:
    """Largest amplitude, 0-to-peak, that a line may have: one torque in one band, or curves over
    frequency.

    Parameters
    ----------
    torque : str or Si
        The amplitude, such as ``"10 mN*m"``.
    low, high : str or Si, optional
        Ends of the band in which it holds, such as ``"0.5 Hz"`` and ``"150 Hz"``; without them it
        holds at all frequencies.

    Raises
    ------
    OptionError
        For a bare number, and for what is no limit or band.

    See Also
    --------
    microvib.read_limit : curves from a CSV file.

    Examples
    --------
    >>> import microvib as mv
    >>> mv.Limit("10 mN*m", "0.5 Hz", "150 Hz")
    Limit of 10 mN m from 0.5 to 150 Hz
    >>> mv.Limit.over_frequency([("1 Hz", "5 mN*m"), ("100 Hz", "50 mN*m")])
    Limit of 5 to 50 mN m over frequency, from 1 to 100 Hz
    """

    curve: LimitCurve | None
    """Limit of the disturbance torque about the drive axis [N m]; None where only loads have one."""
    loads: Mapping[str, LimitCurve] = field(hash=False)
    """Limits of the loads on the spacecraft, forces [N] and moments [N m], by their components ``Fx``
    to ``Mz``."""
    source: str
    """Where it was read; empty without a file."""

    def __init__(
        self,
        torque: GivenQuantity,
        low: GivenQuantity = EVERYWHERE[0],
        high: GivenQuantity = EVERYWHERE[1],
    ) -> None:
        most = quantity("torque", torque, "N*m", positive=True)
        self._set(LimitCurve.flat(most, *band((low, high))), {}, "")

    def _set(self, curve: LimitCurve | None, loads: Mapping[str, LimitCurve], source: str) -> None:
        given = {"torque": curve, **loads}
        for name, one in given.items():
            most = 0.0 if one is None else one.most
            if _LARGEST < most < math.inf:
                unit = "N" if name.startswith("F") else "N*m"
                raise OptionError(
                    "limit",
                    f"{most:g} {unit} is not allowed; at most {_LARGEST:g} {unit} is expected (m is"
                    " milli, M is mega)",
                )
        object.__setattr__(self, "curve", curve)
        object.__setattr__(self, "loads", dict(loads))
        object.__setattr__(self, "source", source)

    @classmethod
    def of_curves(
        cls,
        curve: LimitCurve | None,
        loads: Mapping[str, LimitCurve] | None = None,
        source: str = "",
    ) -> Limit:
        """Make a limit of curves.

        Parameters
        ----------
        curve : LimitCurve or None
            Of the disturbance torque about the drive axis [N m].
        loads : mapping, optional
            Of loads on the spacecraft, by their components ``Fx`` to ``Mz`` [N], [N m].
        source : str
            Where they come from.

        Returns
        -------
        Limit
            The limit.

        Raises
        ------
        OptionError
            Without a curve, and for a component that is none.
        """
        loads = loads or {}
        for name in loads:
            if name not in COMPONENTS:
                raise OptionError(
                    "limit", f"has no component {name}; there are {', '.join(COMPONENTS)}"
                )
        if curve is None and not loads:
            raise OptionError("limit", "limits nothing; a curve over frequency is expected")
        made = object.__new__(cls)
        made._set(curve, loads, source)
        return made

    @classmethod
    def over_frequency(cls, points: Sequence[tuple[GivenQuantity, GivenQuantity]]) -> Limit:
        """Make a limit of the torque about the drive axis from points of its curve.

        Parameters
        ----------
        points : sequence of pairs
            Frequencies and amplitudes, such as ``("1 Hz", "5 mN*m")``, by rising frequency.

        Returns
        -------
        Limit
            The limit.

        Raises
        ------
        OptionError
            Where they are no points of a curve.
        """
        frequency = [quantity("limit", f, "Hz") for f, _ in points]
        amplitude = [quantity("limit", a, "N*m", positive=True) for _, a in points]
        return cls.of_curves(LimitCurve(tuple(frequency), tuple(amplitude)))

    @classmethod
    def of(cls, limit: GivenQuantity | None, ends: Band | None) -> Limit | None:
        """Make the limit that a torque and the band state in which it holds.

        Parameters
        ----------
        limit : str, Si or None
            Largest amplitude, such as ``"10 mN*m"``; None for no limit.
        ends : str or pair, optional
            The band, ``"0.5:150 Hz"`` or both ends.

        Returns
        -------
        Limit or None
            None without a limit.

        Raises
        ------
        OptionError
            For a band without a limit, and for what is no limit or band.
        """
        if limit is None:
            if ends is not None:
                raise OptionError(
                    "band",
                    "is the band of a limit; give the limit too, such as '10 mN*m'",
                    remedy="limit",
                )
            return None
        torque = quantity("limit", limit, "N*m", positive=True)
        return cls(torque, *(() if ends is None else band(ends)))

    def within(self, ends: Band | None) -> Limit:
        """The part of the limit in a band.

        Parameters
        ----------
        ends : str, pair or None
            The band, ``"0.5:150 Hz"`` or both ends [Hz]; None for all of it.

        Returns
        -------
        Limit
            The limit in that band.

        Raises
        ------
        OptionError
            Where one of its curves has no part in the band.
        """
        if ends is None:
            return self
        low, high = band(ends)

        def cut(name: str, curve: LimitCurve) -> LimitCurve:
            part = curve.within(low, high)
            if part is None:
                raise OptionError(
                    "band",
                    f"{low:g} to {high:g} Hz has no part of the limit of {name}, which is given from"
                    f" {curve.low:g} to {curve.high:g} Hz",
                )
            return part

        torque = None if self.curve is None else cut("the torque", self.curve)
        loads = {name: cut(name, curve) for name, curve in self.loads.items()}
        return self.of_curves(torque, loads, self.source)

    def in_band_of(self, other: Limit) -> Limit:
        """Make the limit of its one number in the band of another one.

        Parameters
        ----------
        other : Limit
            The limit whose band is taken.

        Returns
        -------
        Limit
            The limit.
        """
        return Limit(Si(self.torque), Si(other.low), Si(other.high))

    def torque_curve(self, what: str) -> LimitCurve:
        """Take the curve of the torque about the drive axis, which is all that some studies look at.

        Parameters
        ----------
        what : str
            The study, in words, for the message.

        Returns
        -------
        LimitCurve
            The curve [N m].

        Raises
        ------
        OptionError
            Where the limit has none, or limits loads as well.
        """
        if self.curve is None or self.loads:
            raise OptionError(
                "limit",
                f"is of {', '.join(self.loads)}, and {what} looks at the torque about the drive axis"
                " alone; a column such as t_mnm is expected, and no other",
            )
        return self.curve

    @property
    def torque(self) -> float:
        """The least torque that it allows anywhere [N m]: of one number, that; infinite where it
        limits no torque about the drive axis.
        """
        return math.inf if self.curve is None else self.curve.least

    @property
    def low(self) -> float:
        """Frequency [Hz] from which on it holds."""
        return min(curve.low for curve in self._all)

    @property
    def high(self) -> float:
        """Frequency [Hz] up to which it holds."""
        return max(curve.high for curve in self._all)

    @property
    def is_one_number(self) -> bool:
        """Whether it is one torque in one band."""
        return self.curve is not None and self.curve.is_flat and not self.loads

    @property
    def _all(self) -> list[LimitCurve]:
        return [*([] if self.curve is None else [self.curve]), *self.loads.values()]

    @property
    def band(self) -> str:
        """The band in words; empty if the limit holds for all frequencies."""
        if math.isfinite(self.high):
            return f"from {self.low:g} to {self.high:g} Hz"
        if self.low > 0.0:
            return f"from {self.low:g} Hz"
        return ""

    @property
    def words(self) -> str:
        """Amplitudes that it allows, in words: ``10 mN m``, or ``5 to 50 mN m over frequency``."""
        if self.is_one_number:
            return f"{1e3 * self.torque:.4g} mN m"
        if self.curve is None:
            return f"over frequency of {', '.join(self.loads)}"
        also = f" and of {', '.join(self.loads)}" if self.loads else ""
        least, most = 1e3 * self.curve.least, 1e3 * self.curve.most
        if least == most:
            return f"{least:.4g} mN m over frequency{also}"
        return f"{least:.4g} to {most:.4g} mN m over frequency{also}"

    def __repr__(self) -> str:
        of = "" if self.curve is None else "of "
        if self.is_one_number:
            return f"Limit of {self.words} {self.band or 'at all frequencies'}"
        return f"Limit {of}{self.words}, {self.band or 'at all frequencies'}"

    def holds(self, frequency: float, tolerance: float = 0.0) -> bool:
        """Tell whether the limit holds at a frequency; the ends of the band belong to it.

        Parameters
        ----------
        frequency : float
            Frequency [Hz].
        tolerance : float
            To what it is known [Hz].

        Returns
        -------
        bool
            Whether the frequency may lie in the band.
        """
        return bool(within_band(frequency, self.low, self.high, tolerance))

    def as_dict(self) -> dict[str, Any]:
        """List its numbers for JSON, which ``from_dict`` reads back.

        Returns
        -------
        dict
            Least torque [N m], band [Hz], and points of the curves where it is not one number.
        """
        told: dict[str, Any] = {"torque": self.torque, "low": self.low, "high": self.high}
        if self.is_one_number:
            return told
        if self.curve is not None:
            told["curve"] = _as_points(self.curve)
        if self.loads:
            told["loads"] = {name: _as_points(curve) for name, curve in self.loads.items()}
        return told | {"source": self.source}

    @classmethod
    def from_dict(cls, told: Mapping[str, Any]) -> Limit:
        """Make the limit of what ``as_dict`` gave.

        Parameters
        ----------
        told : mapping
            The numbers, with None for what is infinite.

        Returns
        -------
        Limit
            The limit.
        """
        if "source" not in told:
            torque, low, high = (told[key] for key in ("torque", "low", "high"))
            end = math.inf if high is None else float(high)
            return cls(Si(torque), Si(low or 0.0), Si(end))
        curve = _of_points(told["curve"]) if "curve" in told else None
        loads = {name: _of_points(points) for name, points in told.get("loads", {}).items()}
        return cls.of_curves(curve, loads, str(told["source"]))


def _as_points(curve: LimitCurve) -> list[list[float]]:
    return [list(point) for point in zip(curve.frequency, curve.amplitude, strict=True)]


def _of_points(points: Sequence[Sequence[float | None]]) -> LimitCurve:
    frequency = tuple(math.inf if f is None else float(f) for f, _ in points)
    return LimitCurve(frequency, tuple(float(a or math.nan) for _, a in points))


def limit_words(limit: float | LimitCurve, digits: int = 6) -> str:
    """A limit of a torque in words: ``10 mN m``, or ``5 to 50 mN m over frequency``."""
    if not isinstance(limit, LimitCurve):
        return f"{1e3 * limit:.{digits}g} mN m"
    if limit.is_flat:
        return f"{1e3 * limit.least:.{digits}g} mN m"
    return f"{1e3 * limit.least:.{digits}g} to {1e3 * limit.most:.{digits}g} mN m over frequency"


def in_band(limit: float | LimitCurve, ends: tuple[float, float]) -> LimitCurve:
    """A limit in a band [Hz], as a curve: a number is the same throughout, a curve is cut.

    OptionError where a curve has no part in the band.
    """
    if isinstance(limit, LimitCurve):
        return _cut(limit, ends)
    return LimitCurve.flat(limit, *ends)


def _cut(curve: LimitCurve, ends: tuple[float, float]) -> LimitCurve:
    part = curve.within(*ends)
    if part is None:
        raise OptionError(
            "band",
            f"{ends[0]:g} to {ends[1]:g} Hz has no part of the limit, which is given from"
            f" {curve.low:g} to {curve.high:g} Hz",
        )
    return part
