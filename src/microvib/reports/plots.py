"""The front door of figures: ``plot(whatever)``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from microvib.analysis.lines import find_lines
from microvib.analysis.spectra import Sampled, samples_of
from microvib.errors import expect
from microvib.reports import figures, sheets
from microvib.reports.identification import draw_before_and_after
from microvib.reports.order_tracking import draw_orders
from microvib.reports.rates import draw_campbell
from microvib.signals.line_table import LineTable
from microvib.signals.spectrum import Density, Spectrum, Waterfall
from microvib.solve.motion import Motion
from microvib.studies.compare import Comparison
from microvib.studies.identify.fit import Fit
from microvib.studies.rates import RatePlan
from microvib.studies.track import OrderTracking
from microvib.units import GivenQuantity, pretty, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Plotted = (
    Motion
    | Spectrum
    | Density
    | Waterfall
    | RatePlan
    | Comparison
    | Fit
    | OrderTracking
    | Mapping[str, Sampled]
)


def plot(
    what: Plotted, table: LineTable | None = None, *, highest: GivenQuantity = "200 Hz"
) -> Figure:
    """Draw a figure of a result.

    The figure belongs to no global state of Matplotlib: a notebook shows it, ``savefig`` writes it.

    Parameters
    ----------
    what : Motion, Spectrum, Density, Waterfall, RatePlan, Comparison, Fit, OrderTracking or mapping
        A motion (history, microsteps, spectrum with named lines, array mode), a spectrum, a density
        or a waterfall, a rate plan (Campbell diagram), a comparison (both spectra), a fit (test,
        before, after), orders of a sweep (order cuts, Campbell diagram), or several sources with samples over each other, by name.
    table : LineTable, optional
        Lines that are named.
    highest : str or Si
        End of the axis of spectra.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    ObjectError
        For what cannot be drawn.
    """
    top = quantity("highest", highest, "Hz", positive=True)
    figure = _drawn(what, table, top)
    if not isinstance(what, Motion):  # on a sheet as narrow as a report's page
        for ax in figure.axes:
            sheets.set_texts(ax)
    return figure


def _drawn(what: Plotted, table: LineTable | None, highest: float) -> Figure:
    match what:
        case Motion():
            return figures.draw_overview(what, table or find_lines(what))
        case RatePlan():
            return draw_campbell(what)
        case Fit():
            return draw_before_and_after(what)
        case Comparison():
            sides = [side for side in (what.a, what.b) if side.torque is not None]
            return _overlay([(side.name, side.torque, side.sample_rate) for side in sides], highest)
        case OrderTracking():
            return draw_orders(what)
        case Mapping():
            return _overlay(
                [(name, *samples_of(source)[:2]) for name, source in what.items()], highest
            )
    allowed = "a motion, spectrum, density, waterfall, rate plan, comparison, fit or orders, or sources by name"
    expect(what, (Spectrum, Density, Waterfall), allowed)
    return figures.draw_spectral(what, pretty(what.unit), highest, 3.2, table)


def _overlay(sides: Sequence[tuple[str, Any, float]], highest: float) -> Figure:
    figure, ax = sheets.one_axes(3.6)
    figures.draw_overlay(ax, sides, highest)
    return figure
