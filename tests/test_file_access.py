"""Files that are named in data: opened for a command, never for a request of the page, whichever key names them."""

from __future__ import annotations

import copy
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.tiers import sweep

import microvib as mv
from microvib.errors import MicrovibError
from microvib.io.file_access import NO_FILES, FileAccess, sent_files
from microvib.io.named import catalog_text
from microvib.io.scenario_file import scenario_of
from microvib.io.tables import to_json
from microvib.io.yaml_text import parse_yaml
from microvib.model.fields import part_type_of
from microvib.model.scenario import Scenario, set_key
from microvib.studies.budget.angles import budget_over_angles
from microvib.studies.budget.files import Requirements, Sources, from_text
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.study import pointing_budget
from microvib.studies.quiet.study import quiet
from microvib.web.routes import forms

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
SECRET = "PRIVATE-FIGURE-4711"
ENDINGS = (".yaml", ".csv", ".op2", ".h5")
WORDS = (
    "from",
    "fem",
    "scenario",
    "modes",
    "rows",
    "table",
    "loop",
    "file",
    "mass",
    "hub",
    "array",
    "lines",
    "include",
)
"""Keys that name files somewhere in the project's data, and some that might one day."""

_watched: list[str] = []
_watching: list[Path] = []


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _watching and event in ("open", "os.listdir", "os.scandir"):
        name = arguments[0]
        if isinstance(name, (str, bytes, os.PathLike)) and str(_watching[-1]) in os.path.realpath(
            os.fsdecode(name)
        ):
            _watched.append(f"{event} {os.fsdecode(name)}")


sys.addaudithook(_hook)


@pytest.fixture
def secrets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of private files, watched: whoever opens or looks at one of them is written down."""
    for ending in ENDINGS:
        (tmp_path / f"private{ending}").write_text(f"{SECRET}: 1\n")
    real = os.stat

    def stat(path: Any, *args: Any, **more: Any) -> os.stat_result:
        if isinstance(path, (str, os.PathLike)) and str(tmp_path) in os.path.abspath(path):
            _watched.append(f"stat {path}")
        return real(path, *args, **more)

    monkeypatch.setattr(os, "stat", stat)
    _watched.clear()
    _watching.append(tmp_path)
    yield tmp_path
    _watching.pop()


def places(part: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every key of a part at every depth, with the part that it holds, if any; of lists the first item."""
    for name, field in part.model_fields.items():
        inner = part_type_of(field.annotation)
        yield f"{prefix}{name}", inner
        if inner is not None:
            yield from places(
                inner, f"{prefix}{name}.{'0.' if 'tuple' in str(field.annotation) else ''}"
            )


def craft_data() -> dict[str, Any]:
    """Data of a craft with a second wing, whose files are read already."""
    data = parse_yaml(mv.dump_scenario(mv.load_scenario(CRAFT)), "craft")
    other = parse_yaml(catalog_text("state-1"), "state-1")
    wing = {key: other[key] for key in ("motor", "driver", "reducer", "array", "friction")}
    data["spacecraft"]["second_wing"] = {"interface": data["spacecraft"]["interface"], **wing}
    return data


def hostile(folder: Path, part: Any) -> Iterator[Any]:
    yield from (str(folder / f"private{ending}") for ending in ENDINGS)
    yield [str(folder / "private.csv")]
    for word in (*WORDS, *(() if part is None else part.model_fields)):
        yield {word: str(folder / f"private{'.yaml' if word in ('fem', 'scenario') else '.csv'}")}


def attacked(data: dict[str, Any], key: str, value: Any) -> dict[str, Any] | None:
    """The data with a value at a key; beside what stands there, too, where that is a group; None where there is no such place."""
    changed = copy.deepcopy(data)
    try:
        set_key(changed, key, value)
    except MicrovibError:
        return None
    return changed


SHARES = pytest.mark.parametrize("share", sweep(range(3), 0))
"""Thirds of what is tried: each key with a third of the values every time, with the others at a release."""


def shared(values: Iterable[Any], share: int) -> list[Any]:
    return list(values)[share % 3 :: 3]


def said(data: dict[str, Any]) -> str:
    """What is answered to the page: the scenario or the error."""
    try:
        return str(scenario_of(data, "scenario", None, forms.FILES))
    except MicrovibError as error:
        return str(error)


@SHARES
def test_no_key_at_any_depth_opens_a_file(secrets: Path, share: int) -> None:
    data, tried = craft_data(), 0
    for k, (key, part) in enumerate(places(Scenario)):
        for value in shared(hostile(secrets, part), share + k):
            changed = attacked(data, key, value)
            if changed is None:
                continue
            tried += 1
            assert SECRET not in said(changed)
            assert _watched == [], f"{key}: {value}"
    assert tried > 600


@SHARES
def test_no_change_of_a_key_opens_a_file(secrets: Path, share: int) -> None:
    """As the form sends them: dotted keys with texts, those that the schema does not know among them."""
    own = [
        f"{group}.{word}"
        for group in ("array", "spacecraft", "spacecraft.hub", "spacecraft.second_wing")
        for word in WORDS
    ]
    keys = [
        *own,
        *(key for key, _ in places(Scenario)),
        "spacecraft.second_wing.array.from",
        "spacecraft.second_wing.array.fem",
    ]
    name = str(secrets / "private.yaml")
    values = (
        name,
        f"{{scenario: {name}, array: {{fem: {name}}}}}",
        f"{{second_wing: {{scenario: {name}}}}}",
    )
    for k, key in enumerate(keys):
        for value in shared(values, share + k):
            view = forms.view_of(forms.Spec(base="state-1", changes={key: value}))
            assert SECRET not in str(view), (key, value)
            assert _watched == [], (key, value)


OF_A_SEARCH = {
    "objective": {"objective": "NAME"},
    "requirement": {"requirement": "NAME"},
    "study": {"study": "NAME"},
    "check": {"check": "NAME", "levers": []},
    "keep": {"keep": "NAME"},
}


@pytest.mark.parametrize("key", OF_A_SEARCH)
def test_a_search_for_a_quieter_drive_opens_none(secrets: Path, key: str) -> None:
    """With the page's permission; with that of a command the watch sees the file."""
    drive = mv.load_scenario("state-1")
    name = str(secrets / "private.csv")
    Path(name).write_text(f"{SECRET}: 1\n" * 3)  # no file that any of the options takes
    _watched.clear()
    given = {k: name if v == "NAME" else v for k, v in OF_A_SEARCH[key].items()}
    asked: dict[str, Any] = {"levers": ["ramp"], **given}
    with pytest.raises(MicrovibError, match=rf"{key}.*names a file, and the page opens no files"):
        quiet(drive, files=forms.FILES, **asked)
    assert _watched == []
    with pytest.raises(MicrovibError):
        quiet(drive, **asked)
    assert _watched


WHEEL = {"speed": "1800 rpm", "axis": [0, 0, 1], "table": "NAME"}
OF_A_BUDGET = {
    "requirement": {"requirements": "NAME"},
    "sources": {"sources": "NAME"},
    "campaign": {"campaign": "NAME"},
    "wheel.table": {"sources": [{"name": "a", "wheel": WHEEL, "position": ["0 m"] * 3}]},
    "lines": {"sources": [{"name": "a", "lines": "NAME"}]},
    "density": {"sources": [{"name": "a", "density": "NAME"}]},
}


def named(given: Any, name: str) -> Any:
    """The data with the name of a file in the places for it."""
    if isinstance(given, dict):
        return {key: named(value, name) for key, value in given.items()}
    if isinstance(given, list):
        return [named(value, name) for value in given]
    return name if given == "NAME" else given


def keys_of_budget(key: str, name: str) -> dict[str, Any]:
    """Options of a budget that name a file at a key."""
    given = named(OF_A_BUDGET[key], name)
    if isinstance(given.get("sources"), list):
        given["sources"] = from_text(to_json(given), Sources, "sources").sources
    return given


@pytest.mark.parametrize("judge", [pointing_budget, budget_over_angles])
@pytest.mark.parametrize("key", OF_A_BUDGET)
def test_a_budget_opens_none(secrets: Path, key: str, judge: Any) -> None:
    """With the page's permission, or where other files were sent; with that of a command the watch
    sees the file."""
    more = {"angles": ["0 deg"]} if judge is budget_over_angles else {}
    if more and key == "campaign":
        pytest.skip("a campaign is of one angle")
    craft = mv.load_scenario(CRAFT)
    name = str(secrets / "private.csv")
    Path(name).write_text(f"{SECRET}: 1\n" * 3)
    _watched.clear()
    asked = keys_of_budget(key, name)
    sent = sent_files(secrets, {"other.csv": ""}, "it was not sent")
    for files, words in ((forms.FILES, "the page opens no files"), (sent, "it was not sent")):
        with pytest.raises(MicrovibError, match=rf"{key}: .*names a file, and {words}"):
            judge([craft], files=files, **asked, **more)
        assert _watched == []
    with pytest.raises(MicrovibError):
        judge([craft], **asked, **more)
    assert _watched


def said_of_description(data: Any, kind: Any, craft: mv.Scenario, sent: FileAccess) -> str:
    """What is answered of requirements or sources: the error, if there is one."""
    try:
        made = from_text(to_json(data), kind, "x")
        for source in getattr(made, "sources", ()):
            for key, table in source.tables.items():
                sent.under(key).path(table)
            if not source.tables:
                contribution_of_other(source, craft, sent)
    except MicrovibError as error:
        return str(error)
    return ""


@SHARES
@pytest.mark.parametrize("kind", [Requirements, Sources])
def test_no_key_of_requirements_or_sources_opens_a_file(
    secrets: Path, kind: Any, share: int
) -> None:
    """Whatever is named at any key at any depth: of a request only what was sent with it is opened."""
    craft = mv.load_scenario(CRAFT)
    sent = sent_files(secrets, ["other.csv"], "it was not sent")
    start = {
        Requirements: [{"requirements": [{"limit": "1 urad", "curve": []}]}],
        Sources: [named(given, "other.csv") for given in OF_A_BUDGET.values() if isinstance(given.get("sources"), list)],
    }[kind]  # fmt: skip
    tried = 0
    for data in start:
        for k, (key, part) in enumerate(places(kind)):
            for value in shared(hostile(secrets, part), share + k):
                changed = attacked(data, key, value)
                if changed is None:
                    continue
                tried += 1
                assert SECRET not in said_of_description(changed, kind, craft, sent)
                assert _watched == [], f"{key}: {value}"
    assert tried > 60


@pytest.mark.parametrize(
    "name",
    ["../a.csv", "a/b.csv", "/a.csv", "..", ".a.csv", "C:a.csv", "a\\b.csv", "a\0.csv", "", " a.csv", "a" * 101],
)  # fmt: skip
def test_what_is_sent_is_called_by_a_name_alone(name: str) -> None:
    with pytest.raises(MicrovibError, match=r"^tables: .* the name of a table such as"):
        sent_files(Path("a"), ["b.csv", name], "it was not sent")


def test_of_a_folder_of_what_was_sent_nothing_else_is_opened() -> None:
    """Nor a file of the same name elsewhere."""
    files = sent_files(Path("a"), ["b.csv"], "it was not sent")
    assert files.under("lines").path("b.csv") == Path("a/b.csv")
    assert files.in_folder_of("b.csv").path("b.csv") == Path("a/b.csv")
    assert files.in_working_folder().path("b.csv") == Path("a/b.csv")
    for name in ("c.csv", "./b.csv", "../a/b.csv", str(Path("a").resolve() / "b.csv"), "B.csv"):
        with pytest.raises(MicrovibError, match=r"^lines: .* names a file, and it was not sent$"):
            files.under("lines").path(name)
        with pytest.raises(MicrovibError, match="names a file"):
            files.in_folder_of(name)


NAMED = {
    "array.from": "{array: {from: NAME}}",
    "array.fem": "{array: {fem: NAME}}",
    "driver.table": "{driver: {table: NAME}}",
    "spacecraft.hub.modes": "{spacecraft: {hub: {modes: NAME}}}",
    "spacecraft.line_of_sight.rows": "{spacecraft: {line_of_sight: {rows: NAME}}}",
    "spacecraft.second_wing.scenario": "{spacecraft: {second_wing: {scenario: NAME}}}",
    "spacecraft.second_wing: array.from": "{spacecraft: {second_wing: {array: {from: NAME}}}}",
    "spacecraft.second_wing: array.fem": "{spacecraft: {second_wing: {array: {fem: NAME}}}}",
}


@pytest.mark.parametrize("key", NAMED)
def test_what_a_command_opens_is_refused_where_no_files_are_opened(secrets: Path, key: str) -> None:
    """The same data twice: the watch sees the file where it may be opened, so that it would see it elsewhere."""

    def given() -> dict[str, Any]:
        data = parse_yaml(catalog_text("state-1"), "state-1")
        return {**data, **parse_yaml(NAMED[key].replace("NAME", str(secrets / "private.csv")), "x")}

    with pytest.raises(
        MicrovibError,
        match=rf"{key}: .*names a file, and no files are opened here; write its contents",
    ):
        scenario_of(given(), "x", None, NO_FILES)
    assert _watched == []
    with pytest.raises(MicrovibError):
        scenario_of(given(), "x", None, FileAccess(secrets))
    assert _watched


@pytest.mark.parametrize("name", ["", "a\0b", 7, None, ["a.csv"]])
def test_what_is_no_name_is_said(name: Any) -> None:
    with pytest.raises(
        MicrovibError, match=r"^key: .* is not allowed; the name of a file is expected$"
    ):
        FileAccess(Path()).under("key").path(name)


def test_names_are_relative_to_the_file_in_which_they_stand() -> None:
    files = FileAccess(Path("a")).in_folder_of("b/c.yaml")
    assert files.path("d.csv") == Path("a/b/d.csv")
    assert files.in_working_folder().path("d.csv") == Path("d.csv")
    assert NO_FILES.in_working_folder() == NO_FILES
