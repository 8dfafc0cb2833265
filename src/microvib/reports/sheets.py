"""Figures in the project's style, as wide as a report's page, and their way to SVG."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from microvib.io.writing import Writer
from microvib.reports.drawing import import_artists
from microvib.reports.typography import superscript

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

# Okabe and Ito's colours, which colour-blind people can tell apart.
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#666666",
)
COLOURS = (BLUE, RED, GREEN, ORANGE, PURPLE, "#56B4E9", GREY)

PAGE = 7.0
"""Width of a figure in a report [inch], as wide as its page."""
_LEFT, _RIGHT, _BOTTOM, _TOP, _ACROSS, _DOWN = 0.62, 0.1, 0.43, 0.27, 0.66, 0.74
"""Margins of a plain sheet, and room between its axes [inch]."""


def new_figure(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    layout: Literal["constrained"] | None = "constrained",
) -> tuple[Figure, Any]:
    """Figure and axes in the project's style, without a global plotting state; without a ``layout``
    its margins are to be set.
    """
    import_artists()
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _plain_figure()(figsize=(width, height), dpi=110, layout=layout)
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    for ax in axes.flat:
        ax.grid(True, color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
    return figure, axes


@cache
def _plain_figure() -> type[Figure]:
    from matplotlib.figure import Figure

    class PlainFigure(Figure):
        """A figure whose words are as they are written: names are other people's, and a dollar in
        them begins no formula.
        """

        def draw(self, renderer: Any) -> None:
            for text in _word_texts(self):
                text.set_parse_math(False)
            _with_fallback(self)
            _without_logarithms_of_nothing(self)
            super().draw(renderer)

    return PlainFigure


def legend_name(name: str) -> str:
    """Text that Matplotlib shows in a legend as ``name``: it leaves out names that begin with an
    underscore.
    """
    if name.startswith("_"):
        return f"\u200b{name}"
    return name


def sheet(height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, Any]:
    """Figure and axes for a report, ``height`` in inches."""
    return new_figure(PAGE, height, rows, columns)


def one_axes(height: float) -> tuple[Figure, Any]:
    """A sheet of a report with one pair of axes, and these."""
    figure, axes = sheet(height)
    return figure, axes[0, 0]


def panels(count: int, height: float = 2.0, columns: int = 3) -> tuple[Figure, list[Any]]:
    """A sheet of ``count`` axes in rows across the page, each of ``height`` inches, and these."""
    rows, columns = -(-count // columns), min(count, columns)
    figure, axes = sheet(height * rows, rows, columns)
    for ax in axes.flat[count:]:
        ax.set_visible(False)
    return figure, list(axes.flat[:count])


def plain_sheet(height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, Any]:
    """A sheet for axes with short tick labels: its margins are fixed, where finding them takes a
    third of a drawing's time.
    """
    figure, axes = new_figure(PAGE, height, rows, columns, layout=None)
    wide = (PAGE - _LEFT - _RIGHT - (columns - 1) * _ACROSS) / columns
    high = (height - _BOTTOM - _TOP - (rows - 1) * _DOWN) / rows
    figure.subplots_adjust(
        _LEFT / PAGE,
        _BOTTOM / height,
        1.0 - _RIGHT / PAGE,
        1.0 - _TOP / height,
        _ACROSS / wide,
        _DOWN / high,
    )
    return figure, axes


def svg(figure: Figure) -> str:
    """A figure of a report as SVG, the same text each time; letters are outlines, so that no font
    is needed.
    """
    import matplotlib

    for ax in figure.axes:
        set_texts(ax)
    stream = io.StringIO()
    with (
        matplotlib.rc_context({"svg.hashsalt": "microvib", "svg.fonttype": "path"}),
        warnings.catch_warnings(
            action="ignore", category=UserWarning
        ),  # of characters without a font: the report tells it
    ):
        figure.savefig(
            stream,
            format="svg",
            dpi=200,
            metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")),
        )
    figure.set_layout_engine(
        "none"
    )  # its axes have their places, which take a third of a drawing's time to find
    return stream.getvalue()


_NAME: dict[str, Any] = {"textcoords": "offset points", "fontsize": 7, "zorder": 4,
         "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 0.3, "alpha": 0.85}}  # fmt: skip
_NAME_ANGLE = 35.0
"""Angle of names at points [deg]."""
_BEYOND_AXES = 6.0
"""How far a name may go beyond the axes [pt]."""
_LETTER, _ROW_HEIGHT = 0.62, 1.5
"""Width of a letter and height of a row, over the size of the type."""


def name_points(ax: Axes, names: Iterable[tuple[float, float, str, bool]]) -> list[str]:
    """Name points (x, y, text, bold), the important ones first; a name that would lie on an earlier
    one is left out, and one that is not bold where it would lie on another point or go beyond the axes
    on the right. There a bold one is moved to the left.

    The axes must have their limits. Returns the texts that found room.
    """
    angle = np.radians(-_NAME_ANGLE)
    along = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    right = ax.get_window_extent().x1 * 72.0 / ax.figure.dpi
    names = list(names)
    points = np.array([ax.transData.transform(each[:2]) for each in names]).reshape(-1, 2)
    points = points * (72.0 / ax.figure.dpi) @ along.T
    taken: list[np.ndarray] = []
    said = []
    for x, y, text, bold in names:
        rows = text.split("\n")
        size = _NAME["fontsize"] * np.array(
            [_LETTER * max(map(len, rows)), _ROW_HEIGHT * len(rows)]
        )
        place = ax.transData.transform((x, y)) * 72.0 / ax.figure.dpi
        end = place[0] + size[0] * np.cos(angle) - size[1] * np.sin(angle)
        beyond = max(end - right - _BEYOND_AXES, 0.0)
        if beyond and not bold:
            continue
        low = along @ (place - [beyond, 0.0])
        box = np.array([low, low + size])
        if any(np.all(box[0] < other[1]) and np.all(other[0] < box[1]) for other in taken):
            continue
        if not bold and np.any(np.all((points > box[0] + 1.0) & (points < box[1]), axis=1)):
            continue
        taken.append(box)
        said.append(text)
        weight = "bold" if bold else "normal"
        ax.annotate(
            text,
            (x, y),
            xytext=(4.0 - beyond, 4),
            rotation=_NAME_ANGLE,
            fontweight=weight,
            **_NAME,
        )
    return said


def plain_numbers(axis: Any) -> None:
    """Numbers such as 0.5 and 20 on a logarithmic axis, in place of powers."""
    from matplotlib.ticker import LogFormatter, StrMethodFormatter

    class Plain(LogFormatter):
        def _num_to_string(self, x: float, vmin: float, vmax: float) -> str:
            return f"{x:g}"

    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(Plain(minor_thresholds=(2.0, 0.5)))


def png(figure: Figure) -> Writer:
    """Writer of a figure as PNG to a path."""
    return lambda path: figure.savefig(path, format="png", dpi=200)


def set_texts(ax: Axes) -> None:
    """Sizes for print. A title keeps to its place, and powers of ten need no formulas: finding
    either takes as long as drawing.
    """
    from matplotlib.ticker import LogFormatterSciNotation

    ax.tick_params(labelsize=7.5, which="both")
    for label in (ax.xaxis.label, ax.yaxis.label):
        label.set_fontsize(min(8, label.get_fontsize()))
    ax.set_title(ax.get_title(), y=1.0, fontsize=min(8.5, ax.title.get_fontsize()))
    for axis in (ax.xaxis, ax.yaxis):
        if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
            axis.set_major_formatter(_powers_of_ten()())
            axis.set_minor_formatter(_powers_of_ten()())


def _without_logarithms_of_nothing(figure: Figure) -> None:
    """Make axes linear on which nothing positive is drawn: matplotlib refuses to scale them."""
    for ax in figure.axes:
        for axis, least in (("x", ax.dataLim.minposx), ("y", ax.dataLim.minposy)):
            drawn = getattr(ax, f"get_{axis}scale")()
            if drawn == "log" and not math.isfinite(least):
                getattr(ax, f"set_{axis}scale")("linear")


@cache
def _powers_of_ten() -> type:
    from matplotlib.ticker import LogFormatterSciNotation

    class PowersOfTen(LogFormatterSciNotation):
        """Matplotlib's labels of a logarithmic axis in plain characters."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            power = re.fullmatch(
                r"\$\\mathdefault\{(.*?10)\^\{(.*)\}\}\$", text := super().__call__(x, pos)
            )
            if power is None:
                return text
            return power[1].replace(r"\times", "×") + superscript(power[2])

    return PowersOfTen


def _with_fallback(figure: Figure) -> None:
    """Give texts with characters that the package's font lacks the fonts of the system that have
    them.
    """
    from microvib.reports.fonts import fallback_for

    for text in _word_texts(figure):
        families = fallback_for([text.get_text()]).families
        if families:
            text.set_fontfamily([*text.get_fontfamily(), *families])


def _word_texts(figure: Figure) -> Iterable[Text]:
    """Texts of a figure that are words; figures at ticks need no other font, and asking for them
    takes long.
    """
    from matplotlib.ticker import FixedFormatter

    yield from figure.texts
    for legend in (*figure.legends, *(legend for ax in figure.axes if (legend := ax.get_legend()))):
        yield from legend.get_texts()
    for ax in figure.axes:
        yield from (ax.title, ax.xaxis.label, ax.yaxis.label, *ax.texts)
        for axis in (ax.xaxis, ax.yaxis):
            if isinstance(axis.get_major_formatter(), FixedFormatter):
                yield from axis.get_ticklabels()
