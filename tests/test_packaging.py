"""What is packaged: libraries that are declared, files that go with the sources, and sentences on a library that is missing."""

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from support.tiers import at_a_release

from microvib.errors import missing_library

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]


def names(requirements):
    """Names of required packages, as pip compares them; extras of this package are followed."""
    for requirement in requirements:
        name, extras = re.match(r"([\w.-]+)(?:\[([\w,-]+)\])?", requirement).groups()
        if name == "microvib":
            for extra in extras.split(","):
                yield from names(EXTRAS[extra])
        else:
            yield re.sub(r"[-_.]+", "-", name).lower()


@cache
def distributions():
    """Distributions of each package that is installed."""
    return importlib.metadata.packages_distributions()


def imported(folder):
    """Packages that the modules of a folder import, by the module that does."""
    packages = distributions()
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            modules = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules = [node.module]
            for module in modules:
                top = module.partition(".")[0]
                if top not in sys.stdlib_module_names:
                    yield (
                        path,
                        top,
                        {re.sub(r"[-_.]+", "-", name).lower() for name in packages.get(top, [top])},
                    )


def test_what_the_package_imports_is_declared():
    """By it, or by a library that it always needs, such as pandas by xarray."""
    needed = set(names(PROJECT["project"]["dependencies"]))
    theirs = (
        line
        for name in needed
        for line in importlib.metadata.requires(name) or []
        if "extra" not in line
    )
    declared = {"microvib", *needed, *names(theirs), *names(EXTRAS["all"]), *names(EXTRAS["docs"])}
    assert {
        (p.name, top)
        for p, top, distributions in imported(ROOT / "src")
        if not distributions & declared
    } == set()


def test_what_the_tests_import_is_in_their_extra():
    declared = {"microvib", *names(PROJECT["project"]["dependencies"]), *names(EXTRAS["test"])}
    own = {"support", "small_unit", *(path.stem for path in (ROOT / "tests").iterdir())}
    lacking = {
        (p.name, top)
        for p, top, distributions in imported(ROOT / "tests")
        if not distributions & declared
    }
    assert {(name, top) for name, top in lacking if top not in own} == set()


def test_every_python_is_declared():
    declared = {
        c.rpartition(" ")[2] for c in PROJECT["project"]["classifiers"] if "Python :: 3." in c
    }
    assert declared >= {"3.11", "3.12", "3.13"}
    assert f"{sys.version_info.major}.{sys.version_info.minor}" in declared


def test_a_source_distribution_holds_what_is_needed_to_test_it():
    """Whatever git keeps, but for what only git reads."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    kept = {line.partition("/")[0] for line in listed.splitlines()} - {
        ".gitignore",
        ".gitattributes",
    }
    packaged = {*PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"], "pyproject.toml"}
    assert kept == packaged


@pytest.mark.parametrize(
    ("module", "extra"),
    [
        ("starlette.responses", "[serve]"), ("fastapi", "[serve]"), ("uvicorn", "[serve]"), ("plotly", "[serve]"),
        ("nptdms", "[test-data]"), ("pyfe3d", "[fem]"), ("pyyeti.nastran", "[fem]"),
        ("typst", "[report]"), ("distributed", "[dask]"), ("sphinx.cmd", "[docs]"), ("sphinx_click", "[docs]"),
        ("myst_nb", "[docs]"), ("scipy", ""), ("h11", ""),
    ],
)  # fmt: skip
def test_a_missing_library_is_named_with_its_extra(module, extra):
    error = ModuleNotFoundError(f"No module named {module!r}", name=module)
    package = module.partition(".")[0]
    assert (
        missing_library(error)
        == f"this needs {package}, which is not installed; pip install 'microvib{extra}'"
    )


@pytest.mark.parametrize("module", ["microvib.nothing", "tomllib.nothing", ""])
def test_a_module_that_no_installation_brings_is_a_bug(module):
    assert missing_library(ModuleNotFoundError("No module", name=module)) == ""


@pytest.mark.parametrize(
    ("missing", "extra", "words"),
    [
        at_a_release("starlette", "serve", ["serve", "--no-browser"]),
        ("fastapi", "serve", ["serve", "--no-browser"]),
        at_a_release("uvicorn", "serve", ["serve", "--no-browser"]),
        at_a_release("typst", "report", ["run", "state-1", "--pdf", "--out", "x"]),
        ("pyfe3d", "fem", ["modes", "reference-array"]),
        at_a_release(
            "pyyeti",
            "fem",
            ["modes", "model.op4", "--units", "SI", "--interface", "0,0,0", "--drive-axis", "z"],
        ),
        ("nptdms", "test-data", ["analyse", "recording.tdms"]),
        ("distributed", "dask", ["campaign", "run", "cases", "--on", "dask"]),
    ],
)
def test_a_command_without_its_extra_says_which_one(missing, extra, words, tmp_path):
    for name in ("model.op4", "recording.uff", "recording.tdms"):
        (tmp_path / name).write_bytes(b"TDSm")
    study = "scenario: state-1\nvary: {driver.microsteps: [16]}\n"
    (tmp_path / "study.yaml").write_text(study)
    script = """
import sys
from microvib.cli.main import main
if "campaign" in sys.argv:
    main(["campaign", "create", "study.yaml", "cases"], standalone_mode=False)
sys.modules[sys.argv[1]] = None
main(sys.argv[2:])
"""
    done = subprocess.run(
        [sys.executable, "-c", script, missing, *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1
    assert line.startswith("Error: ")
    assert line.endswith(
        f"this needs {missing}, which is not installed; pip install 'microvib[{extra}]'"
    )
    assert not (tmp_path / "x").exists()
