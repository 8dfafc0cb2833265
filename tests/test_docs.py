"""The site builds without a warning, needs no network, finds what is searched for; pages name what exists; `microvib docs` opens it."""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from support.pages import AT_A_RELEASE

import microvib as mv
from microvib.cli import docs as site
from microvib.cli.main import main

ROOT = Path(__file__).parents[1]
EXECUTED = (
    "validation-common-sada",
    "validation-goniometer",
    "validation-sentinel-4",
    "tutorial",
    "howto/rate",
    "theory/array",
    "theory/lines",
    "validation-table",
    "reference/scenario",
)
PAGES = sorted(
    p.relative_to(ROOT).as_posix() for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts
)
EVERY_PAGE = ["README.md", "CONTRIBUTING.md", "benchmarks/README.md", *PAGES]
# what a browser loads by itself: scripts, styles, pictures, frames, fonts; not the links that a reader may follow
LOADED = re.compile(
    r"""(?:<(?:script|img|iframe|source|video|audio|embed)\b[^>]*\bsrc=|<link\b[^>]*\bhref=|url\(|@import\s|\bfetch\()\s*["']?((?:https?:)?//[^"'\s)]+)"""
)


def needs_sphinx() -> None:
    """Skip a test where what builds the site is not installed: it is of the extra ``docs``, not of ``test``."""
    for library in ("sphinx", "myst_nb", "furo", "sphinx_click", "latex2mathml", "ipykernel"):
        pytest.importorskip(
            library, reason="what builds the site is not installed (microvib[docs])"
        )


BUILD = """
import json, sys
from sphinx.application import Sphinx
docs, out, options = json.loads(sys.argv[1])
app = Sphinx(docs, docs, f"{out}/html", f"{out}/doctrees", "html", options, status=None, warningiserror=True)
app.build()
sys.exit(app.statuscode)
"""


def built(out: Path, not_executed: tuple[str, ...]) -> Path:
    """The site: warnings are errors, and a cell that fails is one."""
    needs_sphinx()
    options: dict[str, list[str]] = {}
    if (
        not_executed
    ):  # what only execution tells is missing: numbers in sentences, and the language of cells
        options["nb_execution_excludepatterns"] = [f"{page}.md" for page in not_executed]
        options["suppress_warnings"] = ["mystnb.glue", "myst-nb.lexer"]
    told = json.dumps([str(ROOT / "docs"), str(out), options])
    command = [sys.executable, "-c", BUILD, told]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return out / "html"


@pytest.mark.parametrize(
    "not_executed",
    [
        pytest.param(AT_A_RELEASE, marks=pytest.mark.long, id="without most cells"),
        pytest.param((), marks=pytest.mark.release, id="whole"),
    ],
)
def test_the_site_is_built_without_a_warning_and_needs_no_network(tmp_path, not_executed):
    html = built(tmp_path, not_executed)
    pages = {
        p.relative_to(html).with_suffix("").as_posix(): p.read_text("utf-8")
        for p in html.rglob("*.html")
    }
    assert {"index", "search", "genindex", *EXECUTED} <= set(pages)
    files = [*html.rglob("*.html"), *html.rglob("*.css"), *html.rglob("*.js")]
    loaded = {str(f): found for f in files if (found := LOADED.findall(f.read_text("utf-8")))}
    assert loaded == {}
    # a script, which a page from a file may load, and not a request
    assert '<script src="searchindex.js"' in pages["search"]
    index = (html / "searchindex.js").read_text("utf-8")
    assert all(word in index for word in ("breakaway", "campbel", "stribeck", "tutori"))
    assert pages["theory/motor"].count("<math") > 20
    assert 'class="math' in pages["theory/torque"]
    assert "\\frac" not in "".join(pages[name] for name in pages if name.startswith("theory/"))
    for name in EXECUTED:
        assert ("cell_output" in pages[name]) == (name not in not_executed), name
    curly = [name for name, text in pages.items() if re.search("[\u2018\u2019\u201c\u201d]", text)]
    assert curly == []  # examples are pasted, from prose and help texts, too
    assert pages["model"].count("<math") > 20
    assert "motor.rotor_teeth" in pages["reference/scenario"]
    assert 'id="microvib-rates"' in pages["reference/cli"]


def test_wide_sentences_are_folded_and_tables_keep_their_columns():
    folded = runpy.run_path(str(ROOT / "docs" / "_ext" / "console.py"))["folded"]
    row = "drive_1     " + 10 * "53.013333      "
    sentence = "  Best: " + " ".join(40 * ["words"])
    first, *rest, last = folded(f"{sentence}\n{row}").split("\n")
    assert " ".join(line.strip() for line in (first, *rest)) == sentence.strip()
    assert max(map(len, (first, *rest))) <= 102
    assert last == row


def test_what_a_browser_loads_is_told_from_what_a_reader_follows():
    assert LOADED.findall('<script async src="https://cdn.example/x.js">') == [
        "https://cdn.example/x.js"
    ]
    assert LOADED.findall("@font-face { src: url(//fonts.example/a.woff2) }") == [
        "//fonts.example/a.woff2"
    ]
    assert (
        LOADED.findall('<a href="https://pypi.org/project/pyfe3d/"> <script src="_static/x.js">')
        == []
    )


@pytest.mark.parametrize("page", EVERY_PAGE)
def test_links_between_the_repository_s_files_lead_somewhere(page):
    file = ROOT / page
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", file.read_text("utf-8"))
    missing = [link for link in links if "://" not in link and not (file.parent / link).exists()]
    assert missing == []


@pytest.mark.parametrize("page", EVERY_PAGE)
def test_what_a_page_names_exists(page):
    """Scripts and tests with their options, files of the sources, Python names."""
    text = (ROOT / page).read_text("utf-8")
    commands = [span.split() for span in re.findall(r"`((?:pytest|python) [^`]+)`", text)]
    run = [(word, words) for words in commands for word in words if word.endswith(".py")]
    files = {*re.findall(r"`([a-z_/]+/[a-z_]+\.py)`", text), *(word for word, _ in run)}
    assert [
        f
        for f in sorted(files)
        if not any((ROOT / top / f).exists() for top in ("", "src/microvib"))
    ] == []
    options = {(f, w.split("=")[0]) for f, words in run for w in words if w.startswith("--")}
    assert [
        (f, option)
        for f, option in sorted(options)
        if f'"{option}"' not in (ROOT / f).read_text("utf-8")
    ] == []
    assert [name for name in re.findall(r"\bmv\.(\w+)", text) if not hasattr(mv, name)] == []


@pytest.mark.parametrize("page", EVERY_PAGE)
def test_tests_that_a_page_picks_by_a_word_are_there(page):
    text = (ROOT / page).read_text("utf-8")
    for file, words in re.findall(r'`pytest (\S+\.py) -k "?([^"`]+?)"?(?: -m "")?`', text):
        names = re.findall(r"^def (test_\w+)", (ROOT / file).read_text("utf-8"), re.M)
        assert [
            word for word in words.split(" or ") if not any(word in name for name in names)
        ] == [], file


def docs(*arguments: str):
    return CliRunner().invoke(main, ["docs", *arguments])


@pytest.fixture
def installed(tmp_path, monkeypatch):
    monkeypatch.setattr(site, "SITE", tmp_path / "site")
    monkeypatch.setattr(site, "PACKAGE", tmp_path)
    return tmp_path


def test_docs_opens_the_site_that_is_in_the_package(installed, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    (installed / "site").mkdir()
    (installed / "site" / "index.html").write_text("<html>")
    assert docs().output.strip() == str(installed / "site" / "index.html")
    assert opened == [(installed / "site" / "index.html").as_uri()]
    assert docs("--path").output.strip() == str(installed / "site" / "index.html")
    assert len(opened) == 1
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    assert docs().output.startswith("No browser could be started; open ")


def test_docs_says_how_to_get_the_site_where_there_is_none(installed, monkeypatch):
    result = docs()
    assert result.exit_code == 1
    assert result.output.startswith("Error: the site is not in this installation; build it")
    monkeypatch.setattr(site, "SOURCE", installed / "no-docs")
    result = docs("--build")
    assert result.exit_code == 1
    assert "needs a checkout of the repository" in result.output


def test_a_site_that_cannot_be_built_leaves_the_old_one(installed, monkeypatch):
    pytest.importorskip("sphinx", reason="what builds the site is not installed (microvib[docs])")
    source = installed / "docs"
    source.mkdir()
    (source / "conf.py").write_text("")
    (source / "index.md").write_text("")  # no page that Sphinx can read: a warning
    (installed / "site").mkdir()
    (installed / "site" / "index.html").write_text("old")
    monkeypatch.setattr(site, "SOURCE", source)
    result = docs("--build")
    assert result.exit_code == 1
    assert "the previous one is unchanged" in result.output
    assert (installed / "site" / "index.html").read_text() == "old"
    (source / "index.md").unlink()
    (source / "index.rst").write_text("A page\n======\n")
    assert docs("--build", "--path").exit_code == 0
    assert "A page" in (installed / "site" / "index.html").read_text()
    assert sorted(p.name for p in installed.iterdir()) == ["docs", "site"]
