"""Reports as data, and as what a reader gets: HTML in one file, PDF on A4 pages."""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from support.print import pages
from support.run_reports import run_report
from support.scenarios import baseline, limit_of

import microvib as mv
from microvib import results
from microvib.analysis.budget import housing_factors
from microvib.analysis.limits import judge
from microvib.cli.main import main
from microvib.io.runs import read_run, write_motion
from microvib.io.writing import LISTING
from microvib.reports.blocks import study_report
from microvib.reports.document import (
    AnimatedMarkup,
    Code,
    Document,
    Fact,
    Figure,
    Form,
    Row,
    Section,
    Table,
    Text,
    pairs,
    table,
)
from microvib.reports.figures import draw_first_page
from microvib.reports.outcome import report_table
from microvib.reports.parameters import STATUSES, Provenance, parameter_items, provenance
from microvib.reports.rendering import html, pdf, report_files
from microvib.reports.run.folder import run_to_folder
from microvib.reports.run.lines import LineRow, line_row
from microvib.signals.line_table import BELOW_FLOOR

LIMIT = limit_of(0.010)
NASTY = '#set text(red) $x^2$ *b* _i_ <script>alert(1)</script> \\ "q" [a](b) @ref // {{ 7*7 }} #image("x") &amp; ✓'


@pytest.fixture(scope="module")
def lines_1(motion_1):
    return mv.find_lines(motion_1)


@pytest.fixture(scope="module")
def document(motion_1, lines_1) -> Document:
    return run_report(motion_1, lines_1, limit=LIMIT).in_form(Form(command="microvib run state-1"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a short run."""
    out = tmp_path_factory.mktemp("report") / "run"
    run_to_folder(
        baseline().with_si({"record.settle": 16.0, "record.duration": 6.0}),
        out,
        limit=limit_of(0.010, 0.5, 60.0),
    )
    return out


@pytest.fixture
def undrawn(monkeypatch):
    """For what is asked of words and figures alone: pictures are left out, since they take the time."""
    monkeypatch.setattr("microvib.reports.sheets.svg", lambda drawing: "<svg/>")


def tables(blocks) -> list[Table]:
    return [block for block in blocks if isinstance(block, Table)]


def section(document: Document, title: str) -> Section:
    (found,) = [s for s in document.sections if s.title == title]
    return found


def column(found: Table, title: str, unit: str | None = None) -> list[str]:
    (k,) = [k for k, c in enumerate(found.columns) if c.title == title and unit in (None, c.unit)]
    return [row.cells[k] for row in found.rows if row.mark != "group"]


# Margins


def test_the_spectrum_names_the_line_that_decides_the_verdict_first(motion_1):
    """A line that is small beside its neighbours, above its limit, or the one nearest to the limit where none is above."""
    table = mv.find_lines(motion_1)
    known = (x for x in table if x.seen and x.kind == "full step" and x.amplitude > 1e-4)
    small = min(known, key=lambda x: x.amplitude)
    for factor in (0.2, 5.0):
        limit = limit_of(factor * small.amplitude, small.frequency - 0.1, small.frequency + 0.1)
        judged = judge(table, limit, motion_1.scenario)
        drawing = draw_first_page(motion_1, table, 200.0, judged)
        texts = [
            text for text in drawing.axes[0].texts if text.get_text().startswith(f"{small.name}\n")
        ]
        assert len(texts) == 1
        assert texts[0].get_fontweight() == "bold"


def test_margins_are_limit_over_amplitude(lines_1, motion_1):
    judged = judge(lines_1, LIMIT, motion_1.scenario)
    margin = judged.of(lines_1["drive_1"])
    assert margin.factor == pytest.approx(0.010 / lines_1["drive_1"].amplitude)
    assert margin.decibel == pytest.approx(20 * math.log10(margin.factor))
    assert margin.verdict != "pass"
    assert [m.factor for m in judged.margins] == sorted(m.factor for m in judged.margins)
    assert {m.line.name for m in judged.margins if m.fails} == {
        x.name for x in lines_1 if x.status == "ok" and x.amplitude > 0.0102
    }


def test_a_line_below_the_limit_passes_and_one_above_fails(lines_1, motion_1):
    amplitude = max(x.amplitude for x in lines_1)
    assert judge(lines_1, limit_of(amplitude * 1.05), motion_1.scenario).verdict == "pass"
    assert judge(lines_1, limit_of(amplitude), motion_1.scenario).verdict == "not judged"
    assert judge(lines_1, limit_of(amplitude * 0.95), motion_1.scenario).above == 1


def test_only_lines_in_the_band_are_judged(lines_1, motion_1):
    judged = judge(lines_1, limit_of(0.010, 0.5, 5.0))
    assert {m.line.name for m in judged.margins} == {
        x.name for x in lines_1 if 0.5 <= x.frequency <= 5.0
    }
    assert judged.of(lines_1["drive_1"]) is None
    assert "from 0.5 to 5 Hz" in str(judged)
    assert "no line" in str(judge(lines_1, limit_of(0.010, 4000.0, 5000.0), motion_1.scenario))


def test_a_line_of_no_amplitude_has_no_figures(lines_1, motion_1, undrawn):
    table_ = replace(lines_1, lines=(replace(lines_1["drive_1"], amplitude=0.0),))
    judged = judge(table_, LIMIT, motion_1.scenario)
    assert str(judged) == "Limit 10 mN m: pass."
    shown = results.Table.of(
        "", LineRow, [line_row(table_.lines[0], judged), line_row(lines_1["drive_2"], judged)]
    ).only(("line", "margin_db", "factor", "verdict"))
    assert shown.texts() == [["drive_1", "pass"], ["drive_2", "outside"]]
    assert run_report(motion_1, table_, limit=LIMIT).facts[0].value == "Pass: 1 line"


def test_what_was_not_found_may_be_as_large_as_its_floor_hides(lines_1):
    hidden = replace(lines_1["drive_1"], status=BELOW_FLOOR, amplitude=1e-6, floor=0.005)
    assert judge(replace(lines_1, lines=(hidden,)), LIMIT).margins[0].verdict != "pass"


def test_a_line_without_amplitude_is_named_not_passed(lines_1, motion_1, undrawn):
    unknown = replace(
        lines_1["drive_2"], amplitude=math.nan, frequency=math.nan, status="not resolved: x"
    )
    table_ = replace(lines_1, lines=(lines_1["full_step_1"], unknown))
    judged = judge(table_, LIMIT)
    assert [x.name for x in judged.unknown] == ["drive_2"]
    notes = [
        b.text for b in run_report(motion_1, table_, limit=LIMIT).first_page if isinstance(b, Text)
    ]
    assert "Not judged: drive_2 (not resolved: x)." in " ".join(notes)


# The document of a run


def test_the_first_page_states_verdict_margins_and_what_was_simulated(document, lines_1, motion_1):
    judged, seen = judge(lines_1, LIMIT, motion_1.scenario), set()
    assert document.facts[0].status == "fail"
    assert document.facts[0].value.startswith(f"FAIL: {judged.above} of ")
    simulated, main = tables(document.first_page)
    assert [row.cells[0] for row in simulated.rows][:4] == ["Drive", "Array", "Motion", "Record"]
    assert simulated.rows[-1].cells[0] == "Invariants"
    assert simulated.rows[-1].cells[1].startswith("all hold")
    for row in main.rows:
        name, _, amplitude, decibel, factor, _, verdict = row.cells
        steady = lines_1[name].status == "ok"  # what decays is judged by its start
        exact = 0.010 / (
            lines_1[name].amplitude if steady else lines_1[name].amplitude_at_start(16.0)
        )
        assert float(amplitude) == pytest.approx(1e3 * lines_1[name].amplitude, rel=1e-3)
        assert float(decibel) == pytest.approx(20 * math.log10(exact), abs=0.051)
        assert float(factor) == pytest.approx(exact, rel=6e-3)
        seen.add(verdict)
        known = {
            "pass": ("pass", "pass"),
            "fail": ("FAIL", "fail"),
            "not judged": ("not judged", "off"),
        }
        assert (verdict, row.mark) == known[judged.of(lines_1[name]).verdict]
    assert {"pass", "FAIL"} <= seen
    assert sum(isinstance(b, Figure) for b in document.first_page) == 1
    assert document.sections[0].new_page


def test_without_a_limit_the_lines_stand_alone(motion_1, lines_1, undrawn):
    document = run_report(motion_1, lines_1)
    _, main = tables(document.first_page)
    assert [c.title for c in main.columns] == [
        "line",
        "frequency",
        "amplitude",
        "what it is",
        "status",
    ]
    assert {row.mark for row in main.rows} == {""}
    assert not any(fact.status for fact in document.facts)


def test_a_small_line_above_a_small_limit_is_listed(motion_1, lines_1, undrawn):
    small = max(
        (x for x in lines_1 if x.status == "ok" and x not in lines_1.notable()),
        key=lambda x: x.amplitude,
    )
    strict = run_report(motion_1, lines_1, limit=limit_of(0.1 * small.amplitude))
    (listed,) = tables(section(strict, "All lines").blocks)
    assert small.name in column(listed, "line")
    assert listed.rows[column(listed, "line").index(small.name)].cells[-1] == "FAIL"


def test_every_parameter_has_a_status(document, motion_1):
    listed = tables(section(document, "Parameters").blocks)[0]
    entries = [
        (key, value)
        for key, value, _ in motion_1.scenario.entries()
        if value is not None and value != ()
    ]
    lacks = (
        "driver.imperfections.",
        "driver.microstep_ramp",
        "driver.delay",
    )  # of these an ideal driver has nothing to say
    parameters = [key for key, value in entries if not (key.startswith(lacks) and value == 0.0)]
    assert len(entries) > len(parameters) > 40
    assert len(column(listed, "key")) == len(parameters)
    assert set(column(listed, "status")) <= set(STATUSES)


def test_status_of_catalog_parameters():
    items = parameter_items(mv.load_scenario("state-1", {"driver.microsteps": 32}))
    listed, _, references = items
    parameters = report_table(listed)
    by_key = dict(
        zip(
            column(parameters, "key"),
            zip(column(parameters, "status"), column(parameters, "basis"), strict=True),
            strict=True,
        )
    )
    assert by_key["microsteps"] == ("set by the user", "")
    assert by_key["stiffness"][0] == "identified"
    assert by_key["stiffness"][1].startswith("5053 ± 210 N m/rad [")
    assert by_key["damping"] == ("assumed", "1 % of critical for the hub on the reducer")
    assert by_key["torque_constant"][0] == "paper"
    number = by_key["torque_constant"][1].strip("[]")
    assert any(
        row == (f"[{number}]", mv.load_scenario("state-1").source) for row in references.rows
    )


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("", Provenance("given")),
        ("our own records", Provenance("given", "", "our own records")),
        ("Motor data sheet, rev. C", Provenance("data sheet", "", "Motor data sheet, rev. C")),
        ("datasheet 4", Provenance("data sheet", "", "datasheet 4")),
        ("assumed", Provenance("assumed")),
        ("assumed: none", Provenance("assumed", "none")),
        ("default", Provenance("default")),
        ("set by the user", Provenance("set by the user")),
        ("computed: from the elements", Provenance("computed", "from the elements")),
        ("finite elements of wing.yaml, 9 modes", Provenance("computed", "", "finite elements of wing.yaml, 9 modes")),
        ("identified from c:/a.uff: 0.141 ± 0.049 kg*m^2", Provenance("identified", "0.141 ± 0.049 kg m²", "identified from c:/a.uff")),
        ("Appl. Sci. 2021, 11, 9076, Table 2", Provenance("paper", "", "Appl. Sci. 2021, 11, 9076, Table 2")),
    ],
)  # fmt: skip
def test_status_in_the_words_of_a_source(source, found):
    assert provenance(source) == found


def test_contributions_add_up_to_the_disturbance_torque(motion_1):
    total = sum(
        factor * motion_1[name] for name, factor in housing_factors(motion_1.scenario).items()
    )
    assert np.abs(total - motion_1["T_d"]).max() < 1e-9 * np.abs(motion_1["T_d"]).max()


def test_phasors_of_the_budget_add_up(document, lines_1):
    (budget,) = tables(section(document, "Torque budget").blocks)
    heads = [c.title for c in budget.columns]
    k = heads.index("drive_1")
    phasors = [
        float(row.cells[k]) * np.exp(1j * math.radians(float(row.cells[k + 1])))
        for row in budget.rows
    ]
    assert abs(sum(phasors[:4]) - phasors[4]) < 0.02 * abs(
        phasors[4]
    )  # phases are printed to a degree
    assert abs(phasors[4]) == pytest.approx(1e3 * lines_1["drive_1"].amplitude, rel=1e-3)
    assert np.angle(phasors[4]) == pytest.approx(lines_1["drive_1"].phase, abs=0.01)


def test_invariants_have_a_verdict_in_words(motion_1, lines_1, document, undrawn):
    (held,) = tables(section(document, "Can it be trusted?").blocks)
    assert set(column(held, "verdict")) == {"holds"}
    broken = replace(
        motion_1, invariants=replace(motion_1.invariants, energy=5e-4, energy_mechanical=0.5)
    )
    bad = run_report(broken, lines_1)
    (found,) = tables(section(bad, "Can it be trusted?").blocks)
    assert column(found, "verdict")[3] == "does NOT hold"
    assert bad.facts[0].value == "NOT to be used"


def test_it_says_how_to_reproduce(document):
    assert [
        b.text
        for b in section(document, "Versions, and how to reproduce").blocks
        if isinstance(b, Code)
    ] == [
        "microvib run scenario.yaml --out again",
        "microvib run state-1",
    ]


# Tables, HTML and PDF of any document


def test_heads_of_tables():
    columns = table(["line", "amplitude [mN m]", "factor [1]", "`key`"], ()).columns
    assert [(c.title, c.unit, c.kind) for c in columns] == [
        ("line", "", "text"), ("amplitude", "mN m", "number"), ("factor", "", "number"), ("key", "", "code"),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def nasty() -> Document:
    grouped = Table(
        table(["name", "value [1]", "`key`"], ()).columns,
        (Row((NASTY,), "group"), Row((NASTY, "1", "a_b.c#"), "fail")),
    )
    blocks = (
        Text(f"{NASTY} and `{NASTY}`"),
        Code(NASTY),
        grouped,
        pairs([(NASTY, NASTY)]),
        AnimatedMarkup("<b>moves</b>"),
    )
    return Document(
        "Kind",
        NASTY,
        NASTY,
        (Fact(NASTY, NASTY, "fail"),),
        blocks[:1],
        (Section(NASTY, blocks),),
        NASTY,
    )


def test_texts_are_no_markup_in_html(nasty):
    page = html(nasty)
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "49" not in re.sub(r"<style>.*</style>", "", page, flags=re.DOTALL)  # nor Jinja's
    assert "<b>moves</b>" in page


def test_texts_are_no_markup_in_pdf(nasty):
    (text,) = pages(pdf(nasty))
    assert re.sub(r"\s", "", text).count(re.sub(r"\s", "", NASTY)) >= 10
    assert "moves" not in text


def test_html_is_one_file_without_a_network(document):
    page = html(document)
    assert "://" not in page
    assert set(re.findall(r"""(?:src|href|action)\s*=\s*["']?([a-z]+:|[^"'\s>]+)""", page)) == {
        "data:"
    }
    assert not re.search(r"@import|url\(", page)
    assert (
        page.count("<img ")
        == sum(isinstance(b, Figure) for s in document.sections for b in s.blocks) + 1
    )
    assert not re.search(r'<img alt=""', page)


def test_pdf_of_a_run(document):
    content = pdf(document)
    assert content.startswith(b"%PDF")
    found = pages(content)
    assert len(found) == 7
    assert document.title in found[0]
    assert "FAIL" in found[0]
    assert "All lines" not in found[0]  # the first page is a page
    assert "All lines" in found[1]
    for k, text in enumerate(found, 1):
        assert f"page {k} of 7" in text
        assert document.made.split("…")[0] in text


def test_rendering_is_deterministic(document, motion_1, lines_1):
    again = run_report(motion_1, lines_1, limit=LIMIT).in_form(Form(command="microvib run state-1"))
    assert html(again) == html(document)
    assert pdf(again) == pdf(document)


def test_a_long_title_leaves_the_first_page_one_page(motion_1, lines_1):
    long = replace(
        motion_1,
        scenario=motion_1.scenario.with_si({"title": "drive " * 80, "source": "sheet " * 300}),
    )
    found = pages(pdf(run_report(long, lines_1, limit=LIMIT)), 2)
    assert "All lines" not in found[0]
    assert "All lines" in found[1]


def test_a_study_is_built_in_a_few_lines():
    made = study_report("Kind", "Title", "Subtitle", first_page=[Text("x")], sections=[]).in_form(
        Form(command="microvib x")
    )
    assert [s.title for s in made.sections] == ["Versions, and how to reproduce"]
    assert sorted(report_files(made, Form(pdf=True))) == ["report.html", "report.pdf"]
    assert list(report_files(made, Form())) == ["report.html"]


def test_no_hyphen_stands_for_a_minus(document):
    assert not re.search(
        r"[ >(]-\d",
        re.sub(
            r"<pre>.*?</pre>|<style>.*?</style>|<code>.*?</code>",
            "",
            html(document),
            flags=re.DOTALL,
        ),
    )


# A run's folder, and the command


def test_a_folder_reads_back_as_it_was_written(folder):
    run = read_run(folder)
    summary = json.loads((folder / "summary.json").read_text())
    assert run.motion.invariants.energy == summary["invariants"]["energy"]
    assert run.versions == summary["versions"]
    assert run.motion.time[0] == 16.0
    assert run.motion["T_d"].size == run.table.samples == 6 * 4096
    assert np.abs(run.motion["T_d"] - run.motion["T_d_force"]).max() < 1e-14
    assert run.table["drive_1"].kind == "drive"
    assert run.table["drive_1"].amplitude == pytest.approx(
        mv.find_lines(run.motion)["drive_1"].amplitude, rel=1e-8
    )


def without_pictures(page: str) -> str:
    return re.sub(r"data:image/svg\+xml;base64,[^\"]*", "", page)


def again(folder, *options: str) -> tuple[str, str]:
    """Both reports of a folder made again: the HTML, and the first page of the PDF."""
    done = CliRunner().invoke(main, ["report", str(folder), "--pdf", *options])
    assert done.exit_code == 0, done.output
    said = [line for line in done.output.splitlines() if line]
    assert said[0].startswith("Disturbance torque T_d")
    assert said[-2:] == [f"Written: {folder / name}" for name in ("report.html", "report.pdf")]
    return (folder / "report.html").read_text(), pages((folder / "report.pdf").read_bytes(), 1)[0]


def test_the_command_makes_the_report_again_with_the_limit_of_the_run(folder):
    written = (folder / "report.html").read_text()
    page, first = again(folder)
    made_by = re.compile(r"<p>Made by:</p>\s*<pre>.*?</pre>", re.DOTALL)
    assert (
        without_pictures(made_by.sub("", page)).split()
        == without_pictures(made_by.sub("", written)).split()
    )
    assert "limit 10 mN m from 0.5 to 60 Hz" in first


def test_another_limit_or_band_or_none(folder, undrawn):
    page, first = again(folder, "--limit", "1 N*m")
    assert "Pass: " in page
    assert "limit 1000 mN m from 0.5 to 60 Hz" in first
    assert "limit 10 mN m from 0.5 to 3 Hz" in again(folder, "--band", "0.5:3 Hz")[1]
    page, first = again(folder, "--limit", "none")
    assert (
        "limit"
        not in re.sub(r"<style>.*</style>", "", without_pictures(page), flags=re.DOTALL).split(
            "<h2>"
        )[0]
    )
    assert "limit" not in first


def test_a_named_file_is_never_replaced_unasked(folder, tmp_path):
    target = tmp_path / "review.pdf"
    target.write_text("mine")
    arguments = ["report", str(folder), "-o", str(target)]
    refused = CliRunner().invoke(main, arguments)
    assert refused.exit_code == 1
    assert "already exists; nothing was written" in refused.output
    assert target.read_text() == "mine"
    assert CliRunner().invoke(main, [*arguments, "--overwrite"]).exit_code == 0
    assert target.read_bytes().startswith(b"%PDF")
    assert [p.name for p in tmp_path.iterdir()] == ["review.pdf"]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            ["report", "nowhere"],
            "holds no motion.nc; the folder of a run with its motion is expected",
        ),
        (["report", "FOLDER", "-o", "x.doc"], "its name must end in .html or .pdf"),
        (["report", "FOLDER", "--pdf", "-o", "x.html"], "its name must end in .pdf"),
        (["report", "FOLDER", "--limit", "10"], "--limit: '10' needs a unit"),
        (["report", "FOLDER", "--limit", "-1 N*m"], "greater than 0"),
        (["report", "FOLDER", "--limit", "5 Hz"], "wrong dimension"),
        (
            ["report", "FOLDER", "--limit", "none", "--band", "1:2 Hz"],
            "cannot be combined with --limit none",
        ),
        (["run", "state-1", "--band", "1:2 Hz"], "(--limit)"),
        (
            ["run", "state-1", "--report-data", "nowhere.yaml"],
            "nowhere.yaml: there is no such file",
        ),
        (["run", "state-1", "--lines-only", "--pdf"], "--lines-only makes no report"),
        (["compare", "state-1:measured", "state-1:model", "--pdf"], "give one (--out)"),
    ],
)
def test_bad_input_is_one_sentence(arguments, complaint, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        main, [str(folder) if text == "FOLDER" else text for text in arguments]
    )
    assert done.exit_code == 1
    assert complaint in done.output
    assert done.output.count("Error:") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("scenario.yaml", "was changed since the run"),
        ("summary.json", "is not a summary of a run"),
        ("lines.csv", "is not a table of lines"),
        ("motion.nc", "is not a motion of a run"),
    ],
)
def test_a_damaged_folder_is_one_sentence(name, complaint, folder, tmp_path):
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / name).write_text("line,kind\na,b\n")
    for told in ("was changed since it was written", complaint):
        done = CliRunner().invoke(main, ["report", str(tmp_path), "-o", str(tmp_path / "x.html")])
        assert done.exit_code == 1
        assert f"{tmp_path / name}: {told}" in done.output
        assert not (tmp_path / "x.html").exists()
        (tmp_path / LISTING).unlink(missing_ok=True)


@pytest.fixture
def edited(folder, tmp_path):
    """A run's folder whose largest line was made smaller by hand."""
    out = tmp_path / "edited"
    shutil.copytree(folder, out)
    head, *rows = (out / "lines.csv").read_text().splitlines()
    k = head.split(",").index("amplitude_n_m")
    cells = [row.split(",") for row in rows]
    changed = [[*row[:k], "0.001", *row[k + 1 :]] if row[0] == "drive_1" else row for row in cells]
    assert changed != cells
    (out / "lines.csv").write_text("\n".join([head, *(",".join(row) for row in changed), ""]))
    return out


@pytest.mark.parametrize(
    "command",
    [
        ["report", "FOLDER", "--limit", "30 mN*m"],
        ["compare", "FOLDER", "state-1:measured"],
        ["compare", "FOLDER/lines.csv", "state-1:measured"],
    ],
)
def test_a_run_that_was_edited_is_not_the_runs(edited, command):
    before = (edited / "report.html").read_bytes()
    done = CliRunner().invoke(main, [text.replace("FOLDER", str(edited)) for text in command])
    assert done.exit_code == 1
    assert f"{edited / 'lines.csv'}: was changed since it was written; put it back" in done.output
    assert "pass" not in done.output
    assert (edited / "report.html").read_bytes() == before


def test_a_motion_of_another_run_is_refused(folder, tmp_path):
    out = tmp_path / "mixed"
    shutil.copytree(folder, out)
    other = mv.simulate(baseline().with_si({"record.settle": 0.1, "record.duration": 0.2}))
    write_motion(other, out / "other.nc")
    (out / "other.nc").replace(out / "motion.nc")
    with pytest.raises(mv.MicrovibError, match=r"motion\.nc: was changed since it was written"):
        mv.read_run(out)


def test_a_folder_without_digests_is_read_and_said_so(folder, tmp_path):
    out = tmp_path / "old"
    shutil.copytree(folder, out)
    names = [line.split("  ")[1] for line in (out / LISTING).read_text().splitlines()]
    assert {"lines.csv", "motion.nc", "scenario.yaml", "summary.json"} <= set(names)
    for write in (lambda: (out / LISTING).write_text("\n".join(names)), (out / LISTING).unlink):
        write()
        done = CliRunner().invoke(main, ["report", str(out)])
        assert done.exit_code == 0
        assert "does not tell whether its files are still those of the run" in done.output
    assert mv.read_run(folder).unchecked == ""


def test_a_missing_library_is_told_before_anything_is_computed(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "typst", None)
    done = CliRunner().invoke(main, ["run", "state-1", "--pdf", "--out", str(tmp_path / "run")])
    assert done.exit_code == 1
    assert "pip install 'microvib[report]'" in done.output
    assert not list(tmp_path.iterdir())


def test_other_commands_write_a_pdf_of_the_same_look(tmp_path):
    out = tmp_path / "papers"
    done = CliRunner().invoke(
        main, ["compare", "state-1:measured", "state-1:model", "--out", str(out), "--pdf"]
    )
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in out.glob("[!.]*")) == ["compare.csv", "report.html", "report.pdf"]
    (text,) = pages((out / "report.pdf").read_bytes())
    assert "Comparison of disturbance lines" in text
    assert "microvib compare state-1:measured state-1:model" in text


def test_unusual_values_stand_on_the_first_page(motion_1, lines_1):
    doubtful = replace(
        motion_1, scenario=motion_1.scenario.with_({"array.modes.0.damping": "50 %"})
    )
    for motion, there in ((doubtful, True), (motion_1, False)):
        notes = " ".join(
            b.text for b in run_report(motion, lines_1).first_page if isinstance(b, Text)
        )
        assert (
            "array.modes.0.damping: 50 % is unusual; 0.01 % to 15 % is expected" in notes
        ) == there
