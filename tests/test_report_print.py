"""Reports in print: minus signs, powers of ten, no folders; the title block."""

from __future__ import annotations

import math
import re
import shlex
import warnings
from html import unescape

import numpy as np
import pytest
from support.print import pages

import microvib as mv
from microvib.errors import MicrovibError
from microvib.reports import fonts, sheets
from microvib.reports.blocks import study_report
from microvib.reports.document import Form, Row, Section, Table, Text, table
from microvib.reports.fonts import package_fonts
from microvib.reports.rendering import html, pdf
from microvib.reports.title_block import TitleBlock, read_title_block
from microvib.reports.typography import command_without_folders, typeset_text
from microvib.testdata.recording import Recording

# Characters of print


@pytest.mark.parametrize(
    ("written", "printed"),
    [
        ("-13.6 dB", "−13.6 dB"),
        ("from -1 to -.5, (-2)", "from −1 to −.5, (−2)"),
        ("B - A, B/A - 1", "B − A, B/A − 1"),
        ("drive_1 -1 full step", "drive_1 −1 full step"),
        ("states 1-3, SHA-256, 2026-11-21, x_-1", "states 1-3, SHA-256, 2026-11-21, x_-1"),
        ("at most 1e-09 or 2.5e+03", "at most 10⁻⁹ or 2.5 × 10³"),
        ("`--set x=-3` and -3", "`--set x=-3` and −3"),
        ("B: /home/me/runs.d/a.uff at 0.99", "B: a.uff at 0.99"),
        ("/home/me/a.uff (recording)", "a.uff (recording)"),
        ("from ../../x/b.csv, ~/c/d.mat and C:\\e\\f.csv", "from b.csv, d.mat and f.csv"),
        ("identified from c:/data/a.uff: 1 N m/rad", "identified from a.uff: 1 N m/rad"),
        (
            "drive /Y/B/, phases /A/B at /Y/1.5 A, /home/me/state-1 (run)",
            "drive /Y/B/, phases /A/B at /Y/1.5 A, state-1 (run)",
        ),
        (
            "https://doi.org/10.3390/x, 1 / 2 N m/rad/s",
            "https://doi.org/10.3390/x, 1 / 2 N m/rad/s",
        ),
    ],
)
def test_characters_of_print(written, printed):
    assert typeset_text(written).replace("\u00a0", " ") == printed


def test_no_line_is_broken_before_or_within_a_unit():
    assert typeset_text("16 s, 3.8 mN m, 9 N m/rad, 8 kg m², 12 steps") == (
        "16\u00a0s, 3.8\u00a0mN\u00a0m, 9\u00a0N\u00a0m/rad, 8\u00a0kg\u00a0m², 12 steps"
    )


def test_a_column_that_says_nothing_is_left_out():
    rows = [Row(("all",), "group"), Row(("a", "", "1", "")), Row(("b", "", "", "x"))]
    found = Table(table(["line", "what it is", "size [mm]", "`key`"], ()).columns, tuple(rows))
    made = study_report("Kind", "Title", "Subtitle", first_page=[found], sections=[])
    page = html(made)
    assert "what it is" not in page
    assert '<td colspan="3">all</td>' in page
    assert all(f">{text}<" in page for text in ("line", "key", "a", "1", "b", "x"))


def test_a_command_names_files_and_no_folders():
    command = shlex.join(
        [
            "microvib",
            "run",
            "/home/my runs/a.yaml",
            "--set",
            "array.from=/x/y/m.csv",
            "--out=/tmp/x/out",
            "a/b",
        ]
    )
    assert (
        command_without_folders(command)
        == "microvib run a.yaml --set array.from=m.csv --out=out a/b"
    )


NAMES = "Motor /Y/B/, phases /A/B & <b>no tag</b> $x_1$ _u_ *s* #set [a](b) \\alpha Ж"


def test_a_title_is_printed_as_it_is_written():
    """No part of it is taken for a path, for markup of HTML or Typst, or for a formula."""
    made = study_report(
        "Kind",
        NAMES,
        NAMES,
        first_page=[Text(NAMES), table([NAMES, "b"], [[NAMES, NAMES]], NAMES)],
        sections=[],
    )
    text = unescape(re.sub(r"<(?!b>|/b>)[^>]*>", "", html(made)))
    assert text.count(NAMES) == 7 + 1  # the page's own title, too
    printed = re.sub(r"\s+", " ", " ".join(pages(pdf(made))))
    assert (
        printed.count("/Y/B/, phases /A/B & <b>no tag</b> $x_1$ _u_ *s* #set [a](b) \\alpha Ж") >= 3
    )


def test_names_in_pictures_are_no_formulas():
    """A legend shows names with dollars and a leading underscore, which Matplotlib would set as a formula or leave out."""
    x, names = np.sin(np.arange(4096.0)), ("_first $x_1$", "50 % $ & $")
    figure = mv.plot({name: Recording({"Mz": x}, 1000.0, {"Mz": "N m"}) for name in names})
    sheets.svg(figure)
    written = figure.axes[0].get_legend().get_texts()
    assert [text.get_text().strip("\u200b") for text in written] == list(names)
    assert not any(text.get_parse_math() for text in written)


# Title block


FULL = """
author: A. Engineer
organisation: Example Space
number: XY-TN-0042
issue: 2.0
date: 2026-10-31
signatures: {prepared: A. Engineer, head of department:}
"""


def test_the_title_block_is_on_the_first_page(tmp_path):
    (tmp_path / "report.yaml").write_text(FULL)
    form = Form(title_block=read_title_block(tmp_path / "report.yaml"))
    made = study_report(
        "Kind",
        "Title",
        "Subtitle",
        first_page=[Text("x")],
        sections=[Section("S", (Text("y"),), True)],
    ).in_form(form)
    first, second = pages(pdf(made))
    for text in (
        "A. Engineer",
        "Example Space",
        "XY-TN-0042",
        "2.0",
        "2026-10-31",
        "Head of department",
    ):
        assert text in first
        assert text in html(made)
    assert "XY-TN-0042 · 2.0" in second  # in the head of every page


def test_without_report_data_the_block_is_to_be_filled_in(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    block = TitleBlock()
    assert block.facts == (
        ("Document no.", ""),
        ("Issue", "draft"),
        ("Date", "1970-01-02"),
        ("Author", ""),
    )
    assert [role for role, _ in block.signatures] == ["prepared", "checked", "approved"]
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(
        MicrovibError, match="SOURCE_DATE_EPOCH: 'yesterday' is not allowed; whole seconds"
    ):
        TitleBlock()


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (
            "autor: me",
            "'autor' is not a key of report data; allowed are author, organisation, number, issue",
        ),
        ("author: [a, b]", "author: '['a', 'b']' is not allowed; a text of at most 80 characters"),
        (f"number: {'9' * 81}", "number: '9"),
        ("signatures: {}", "signatures: '{}' is not allowed; 1 to 6 roles"),
        ("signatures: {a: {b: c}}", "signatures.a: "),
        ("- author", "lines such as 'author: A. Engineer' are expected"),
        ("author: 'a", "is not valid YAML"),
    ],
)
def test_bad_report_data_is_one_sentence(content, complaint, tmp_path):
    (tmp_path / "report.yaml").write_text(content)
    with pytest.raises(MicrovibError) as error:
        read_title_block(tmp_path / "report.yaml")
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


# Characters without a font


def test_characters_without_a_font_are_told_in_words(monkeypatch):
    monkeypatch.setattr("matplotlib.font_manager.findSystemFonts", list)
    fonts._found.cache_clear()
    made = study_report("Kind", "衛星 drive", "Subtitle", first_page=[Text("x")], sections=[])
    (page,) = pages(pdf(made))
    assert "has the characters U+661F, U+885B: they are missing" in page
    assert "衛星" in html(made)
    fonts._found.cache_clear()


def test_a_font_of_the_system_is_taken_where_those_of_the_package_lack_characters(monkeypatch):
    stix = (
        package_fonts() / "STIXNonUni.ttf"
    )  # has characters of private use, as a font of the system may
    monkeypatch.setattr(
        "matplotlib.font_manager.findSystemFonts", lambda: [str(stix), "/no/such/font.ttf"]
    )
    fonts._found.cache_clear()
    rare = next(chr(c) for c in sorted(fonts._characters(str(stix))) if 0xE000 <= c < 0xF8FF)
    found = fonts._found(frozenset({rare, "\u885b"}))
    assert (found.families, found.folders) == (("STIXNonUnicode",), (str(stix.parent),))
    assert found.unknown == {"\u885b"}
    fonts._found.cache_clear()


@pytest.mark.parametrize("values", [[math.nan, math.nan], [], [0.0, 0.0], [math.nan, 1.0]])
def test_a_picture_of_nothing_positive_is_drawn_all_the_same(values):
    figure, ax = sheets.one_axes(2.0)
    ax.plot(values, values)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # matplotlib's own, on logarithms of zero
        ax.set(xscale="log", yscale="log")
    assert "<svg" in sheets.svg(figure)
