"""Messages between page and server; the description at /api/openapi.json is made of it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from microvib.model.driver import MAX_TABLE
from microvib.signals.impacts import Estimator
from microvib.signals.spectrum import Average, Window
from microvib.studies.budget.sums import Rule
from microvib.studies.campaign.study_file import Method
from microvib.web.routes.forms import Spec

Id = Annotated[str, Field(pattern="^[0-9a-f]{16}$")]
Short = Annotated[str, Field(max_length=200)]
Table = Annotated[str, Field(max_length=4000)]
"""A table as text."""
MAX_TESTS = 30

MAX_DRAWS = 1000


def _draws(given: Any) -> Any:
    """A whole number, perhaps as text; its sentence where it is none."""
    if isinstance(given, str) and given.isdecimal() and len(given) < 9:
        given = int(given)
    if not isinstance(given, int) or isinstance(given, bool) or not 2 <= given <= MAX_DRAWS:
        raise ValueError(f"a whole number of draws from 2 to {MAX_DRAWS} is expected")
    return given


Draws = Annotated[int, BeforeValidator(_draws), Field(ge=2, le=MAX_DRAWS)]


class Body(BaseModel):
    """Request of a page; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid")


class Run(Body):
    """A simulation."""

    scenario: Spec
    name: Short | None = None
    steady: bool = False
    seeds: Draws | None = Field(
        default=None, description="draws of the noise over which lines are given"
    )


Described = Annotated[str, Field(max_length=200_000)]
"""Text of a file that describes something (YAML)."""
Sent = Annotated[str, Field(max_length=1_000_000)]
"""Text of a table that came with a request."""


class PreparingOf(Body):
    """How recordings are prepared; tables that it names come with it, and no other file is opened."""

    prepare: Described = Field(
        default="", description="a preparation file's text (YAML), as of --prepare"
    )
    tables: dict[Short, Sent] = Field(
        default_factory=dict, max_length=20, description="tables that it names: name and text"
    )


class SectionOf(PreparingOf):
    """A section of a recording, in texts with units as on the command line, and the unit of its channel."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    start: Short | None = Field(default=None, alias="from")
    stop: Short | None = Field(default=None, alias="to")
    trigger: Short | None = Field(default=None, description="such as Mz > 5 mN*m")
    pre_trigger: Short | None = None
    unit: Short | None = Field(
        default=None,
        description="unit of the channel, or its full scale, where the file has none: 20 N*m",
    )


class ProcessingOf(SectionOf):
    """A section and how it is processed."""

    window: Window = "hann"
    average: Average = "none"
    resolution: Short | None = None
    overlap: float = Field(default=0.5, ge=0.0, le=0.95)
    background: Id | None = Field(default=None, description="a recording with the drive off")
    bands: Table | None = Field(
        default=None, description="bands with a limit each, as the text of a CSV table"
    )
    roll_off: float | None = Field(default=None, allow_inf_nan=False)
    limit: Table | None = Field(
        default=None, description="a torque, or the text of a table of a limit over frequency"
    )
    limit_band: Short | None = Field(default=None, description="where the limit applies")


class AnalysisOf(ProcessingOf):
    """Lines, spectra and bands of a recording."""

    recording: Id
    channel: Short = "Mz"
    scenario: Spec


class BatchOf(ProcessingOf):
    """Several recordings processed alike."""

    recordings: list[Id] = Field(min_length=2, max_length=MAX_TESTS)
    channel: Short = "Mz"
    scenario: Spec


class TrackingOf(SectionOf):
    """Orders through a rate sweep; exactly one reference of its speed."""

    recording: Id
    channel: Short = "Mz"
    orders: Short = Field(description="orders, separated by commas: 0.5,1,4,6")
    scenario: Spec | None = None
    profile: Table | None = Field(
        default=None, description="TIME:SPEED, TIME:SPEED, or the text of a CSV table"
    )
    tacho: Short | None = None
    pulses_per_rev: float = Field(default=1.0, gt=0.0, le=1e6)
    speed: Short | None = None
    strongest: float | None = Field(default=None, gt=0.0, le=1e6)
    clock: Literal["found", "stated"] = "found"
    fixed: list[Short] = Field(default_factory=list, max_length=20)
    bandwidth: Short | None = None
    limit: Table | None = Field(
        default=None, description="a torque, or the text of a table of a limit over frequency"
    )


class ComparisonOf(PreparingOf):
    """A recording beside a run, or beside another recording, whose lines a scenario names."""

    recording: Id
    run: Id | None = None
    other: Id | None = None
    scenario: Spec | None = None
    channel: Short = "Mz"
    limit: Table | None = Field(
        default=None, description="a torque, or the text of a table of a limit over frequency"
    )
    limit_band: Short | None = Field(default=None, description="where the limit applies")


class TestOf(Body):
    """A test of a unit."""

    recording: Id
    unit: Short = ""


class RepeatedOf(PreparingOf):
    """Repeated tests."""

    tests: list[TestOf] = Field(min_length=2, max_length=MAX_TESTS)
    channels: list[Short] = Field(default=["Mz"], min_length=1, max_length=6)
    scenario: Spec


class HitOf(Body):
    """A recording of blows along or about one axis of the table."""

    recording: Id
    load: Literal["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    arm: Short | None = Field(default=None, description="lever arm of a torque, such as 0.2 m")


class HammerOf(Body):
    """A hammer test of a force table."""

    hits: list[HitOf] = Field(min_length=1, max_length=MAX_TESTS)
    mounted_mass: Short = Field(description="mass on the table in the test, such as 12 kg")
    impact: Short = Field(default="hammer", description="channel of the hammer's force")
    block: Short | None = None
    estimator: Estimator = "H1"


class AcceptanceOf(PreparingOf):
    """An acceptance report of several recordings from a template."""

    tests: list[TestOf] = Field(min_length=1, max_length=MAX_TESTS)
    channel: Short = "Mz"
    scenario: Spec
    template: Described = Field(description="Markdown with parts such as {{ test.verdicts }}")
    data: Described = Field(default="", description="words of the template, as YAML text")
    limit: Annotated[str, Field(max_length=20_000)] | None = Field(
        default=None, description="a torque, or a table of a limit over frequency as CSV text"
    )
    band: Short | None = None
    reference: Literal["", "scenario"] | Id = Field(
        default="", description="what the first run is compared with: the scenario, or a recording"
    )
    hammer: HammerOf | None = None


class IdentificationOf(PreparingOf):
    """Parameters from recordings."""

    recordings: list[Id] = Field(min_length=1, max_length=10)
    channel: Short = "Mz"
    scenario: Spec
    fit: list[Short] = Field(min_length=1, max_length=12)
    starts: int = Field(default=32, ge=2, le=1000)


class RatesOf(Body):
    """A rate plan."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    scenario: Spec
    low: Short = Field(alias="from")
    high: Short = Field(alias="to")
    count: int = Field(default=100, ge=2, le=2000)
    microsteps: list[Annotated[int, Field(ge=1, le=65_536)]] = Field(
        default_factory=list, max_length=10
    )
    limit: Annotated[str, Field(max_length=20_000)] | None = Field(
        default=None, description="a torque, or a table of a limit over frequency as CSV text"
    )
    band: Short | None = None
    linear: bool = False


class AnglesOf(Body):
    """Runs over angles of the array on its craft."""

    scenario: Spec
    angles: Short = Field(description="FIRST:LAST:STEP in degrees, or a list")
    steady: bool = False
    limit: Annotated[str, Field(max_length=20_000)] | None = Field(
        default=None, description="a torque, or a table of a limit over frequency as CSV text"
    )
    band: Short | None = None


class BudgetOf(Body):
    """A pointing budget; the tables that its sources name come with it, and no other file is opened."""

    scenario: Spec
    requirement: Described = Field(default="", description="requirements, as YAML text")
    sources: Described = Field(
        default="", description="other sources that move the line of sight, as YAML text"
    )
    tables: dict[Short, Sent] = Field(
        default_factory=dict, max_length=20, description="tables that sources name: name and text"
    )
    rule: Rule = Field(default="rss", description="how lines of one frequency add")
    one_clock: bool = False
    steady: bool = False
    angles: Short | None = Field(
        default=None, description="FIRST:LAST:STEP in degrees, or a list; else the scenario's own"
    )
    orbit: bool = False
    other: Spec | None = Field(
        default=None, description="a second design, judged by the same requirements"
    )
    other_sources: Described = Field(
        default="", description="other sources of the second design, as YAML text; else the first's"
    )


class EnvelopeOf(Body):
    """An envelope over runs, rate maps, campaigns, angles and recordings that the page has."""

    members: list[Id] = Field(min_length=1, max_length=100)
    channels: list[Short] = Field(default_factory=list, max_length=7)
    statistics: list[Literal["max", "mean", "p95", "p99"]] = Field(
        default=["max"], min_length=1, max_length=4
    )
    bandwidth: Short = "1/3 octave"
    resolution: Short = "1 Hz"
    limit: Annotated[str, Field(max_length=20_000)] | None = Field(
        default=None, description="a torque, or a table of a limit over frequency as CSV text"
    )
    band: Short | None = None
    scenario: Spec | None = Field(default=None, description="names the lines of recordings")


class QuietOf(Body):
    """A search for a quieter drive, or a table of currents to judge; no file can be named."""

    scenario: Spec
    objective: Annotated[str, Field(max_length=20_000)] = Field(
        default="rms",
        description="rms, a line such as drive_1, a band such as 0.5:150 Hz, or a table of a limit over"
        " frequency as CSV text",
    )
    requirement: Described = Field(
        default="",
        description="requirements on the line of sight, as YAML text, in place of the objective",
    )
    levers: list[Short] = Field(
        default_factory=list,
        max_length=12,
        description="names, with or without a range: current=0.3:0.6 A",
    )
    check: Sent = Field(
        default="", description="a table of currents as CSV text, judged in place of a search"
    )
    study: Described = Field(
        default="", description="study file of a campaign, as YAML text: how drives scatter"
    )
    bits: int | None = Field(default=None, ge=2, le=24)
    table_rows: int = Field(default=MAX_TABLE, ge=4, le=MAX_TABLE)
    cases: int = Field(default=24, ge=8, le=400)
    effort: int = Field(default=24, ge=4, le=1000)
    margin: Short = Field(default="0", description="least torque margin, with the factors")
    factor: list[Short] = Field(
        default_factory=list, max_length=20, description="motorisation factors: friction=1.5"
    )
    lag: Short | None = Field(
        default=None, description="largest angle of the array behind its command: 0.01 deg"
    )
    limit: Short | None = None


class SweepOf(Body):
    """Lines over one value of a scenario."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    scenario: Spec
    key: Short
    low: Short = Field(alias="from")
    high: Short = Field(alias="to")
    count: int = Field(default=11, ge=2, le=200)
    linear: bool = Field(default=False, description="of the linearised drive, in closed form")


Given = dict[Short, Short]


class CampaignOf(Body):
    """A campaign: what varies is written as in a study file; no file can be named."""

    scenario: Spec
    title: Short = ""
    vary: dict[Short, Given | Annotated[list[Short], Field(max_length=50)]] = Field(
        max_length=12,
        description="per key a list of values, a grid {from, to, count, spacing} or a distribution",
    )
    method: Method = "sobol"
    count: int = Field(default=128, ge=1, le=2000, description="points of the sample")
    seed: int = Field(default=1, ge=0, le=2**32 - 1)
    noise: Literal["one", "each"] = "one"
    solve: Literal["record", "steady"] = "steady"
    limit: Annotated[str, Field(max_length=4000)] | None = Field(
        default=None, description="a torque, or a table of a limit over frequency as CSV text"
    )
    band: Short | None = None


class CaseOf(BaseModel):
    """A case of a campaign as changes of its scenario, and whether its steady state was asked for."""

    number: int
    changes: dict[str, str]
    labels: dict[str, str]
    """Values of what varies as a person reads them."""
    steady: bool


class QuietChoices(BaseModel):
    """Lines and levers of a scenario that a search for a quieter drive can be asked for."""

    lines: list[str]
    levers: list[LeverOf]
    line_of_sight: bool
    """Whether there is one, on which requirements are."""


class LeverOf(BaseModel):
    """A named lever with its usual range, which is empty where it has none."""

    name: str
    span: str
    meaning: str
    example: str


class ShapesOf(Body):
    """Mode shapes: of the array with its interface clamped, or of the craft with locked hinges."""

    scenario: Spec
    of: Literal["array", "craft"] = "array"


class RankingOf(Body):
    """Which uncertain value of a scenario matters most."""

    scenario: Spec


class SasOf(Body):
    """Sizing of the simulator."""

    inertia: Short | None = None
    frequency: Short | None = None
    states: list[Short] = Field(default_factory=list, max_length=50)
    amplitude: Short | None = None
    rate: Short | None = None
    from_scenario: Spec | None = None


class SheetOf(Body):
    """Entries of a data sheet, as typed; what it does not state is left out."""

    entries: dict[Short, Short] = Field(max_length=30)


class Problem(BaseModel):
    """Error as a sentence, and the key that it is about."""

    error: str
    key: str | None = None


class Entry(BaseModel):
    """A scenario of the catalog."""

    name: str
    title: str
    source: str


class FormField(BaseModel):
    """One parameter of the form."""

    key: str
    symbol: str
    meaning: str
    unit: str
    range: str
    kind: Literal["quantity", "count", "choice", "flag", "text", "list"]
    optional: bool
    choices: list[str] | None = None
    items: list[FormField] | None = None


class SheetField(FormField):
    """One entry of a data sheet."""

    example: str


class Assumed(BaseModel):
    """A value that the data sheet does not give; ``why`` notes its range, if there is one."""

    key: str
    value: str
    why: str


class Sheet(BaseModel):
    """The scenario file of a data sheet and what it assumes, or what is wrong with the entries."""

    text: str | None
    assumed: list[Assumed]
    errors: list[Problem]


class Group(BaseModel):
    """Fields of one part of the drive."""

    key: str
    title: str
    fields: list[FormField]


class Form(BaseModel):
    """All groups, and whether the server keeps what ends."""

    groups: list[Group]
    keeps: bool = False


class View(BaseModel):
    """A scenario as the form shows it."""

    title: str
    values: dict[str, str]
    base_values: dict[str, str]
    sources: dict[str, str]
    changed: list[str]
    errors: list[Problem]
    derived: list[str]
    unusual: list[str]
    yaml: str | None


class Started(BaseModel):
    """The job that was started."""

    id: str


class Progress(BaseModel):
    """How far a job is; total is null where it is not known."""

    done: float
    total: float | None
    unit: str
    text: str


class JobState(BaseModel):
    """A computation and how it stands."""

    id: str
    kind: Literal[
        "run",
        "analysis",
        "comparison",
        "identification",
        "rates",
        "angles",
        "budget",
        "envelope",
        "quiet",
        "campaign",
        "sweep",
        "shapes",
        "sensitivity",
        "sas",
        "tracking",
        "batch",
        "repeated",
        "hammer",
        "acceptance",
    ]
    title: str
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    progress: Progress
    error: str | None


class ChannelOf(BaseModel):
    """A channel of a recording."""

    name: str
    unit: str
    rms: float | None


class RecordingFacts(BaseModel):
    """A recording that was read."""

    id: str
    name: str
    channels: list[ChannelOf]
    sample_rate: float
    samples: int
    duration: float
    notes: list[str]


class RecordingHere(BaseModel):
    """A recording that can be processed, in short."""

    id: str
    name: str
    channels: list[str]
    duration: float
    sample_rate: float


class Kept(BaseModel):
    """An entry of the library."""

    id: str
    kind: str
    title: str
    created: str
    version: str
    kept: bool
    attributes: dict[str, str]
    size: int


class KeptWhole(Kept):
    """An entry with the request that it is the answer to."""

    asked: dict[str, Any]


class LibraryOf(BaseModel):
    """The library of the server; ``there`` is false where nothing outlasts it."""

    there: bool
    entries: list[Kept]


class EntryChanges(Body):
    """Changes of an entry: its name, attributes, and whether it stays when others make room."""

    title: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    kept: bool | None = None
    attributes: dict[Short, Short] | None = Field(default=None, max_length=20)


class Band(BaseModel):
    """Extremes of groups of samples."""

    unit: str
    min: list[float]
    max: list[float]


class Series(BaseModel):
    """A stretch of some channels."""

    start: float = Field(alias="from")
    stop: float = Field(alias="to")
    exact: bool
    t: list[float]
    channels: dict[str, Band]


class RecordedSeries(BaseModel):
    """A window of a recording's channel: samples, or the smallest and largest of groups of them."""

    start: float
    stop: float
    exact: bool
    unit: str
    t: list[float]
    min: list[float | None]
    max: list[float | None]
    """Empty where every sample is there."""


class SpectrumOf(BaseModel):
    """A stretch of a spectrum, 0-to-peak."""

    f: list[float]
    amplitude: list[float]
    unit: str
    resolution: float
    made: str


class MarginOf(BaseModel):
    """One line against a limit."""

    line: str
    verdict: Literal["pass", "fail", "not judged"]


class LevelOf(BaseModel):
    """A level of a torque [N m], and between what it may be."""

    line: str
    value: float
    least: float
    most: float | None
    """None where nothing bounds it."""


class LevelsOf(BaseModel):
    """The largest line in a band, 0-to-peak, and the RMS of its lines."""

    largest: LevelOf
    rms: LevelOf


class Verdict(BaseModel):
    """Lines of a run against a limit [N m] between two frequencies [Hz], the smallest margin first."""

    text: str
    verdict: Literal["pass", "fail", "not judged"]
    gaps: list[str]
    """Gaps in the judgement, and why."""
    torque: float | None
    """Least that is allowed anywhere; None where only loads are limited."""
    low: float
    high: float | None
    curve: list[tuple[float, float]] | None
    """Points of a limit over frequency [Hz], [N m]; None of one number."""
    margins: list[MarginOf]
    levels: LevelsOf | None
    """Levels in the band; None of a run with a second drive."""
    facts: list[dict[str, str]]
    """Leading figures of the run against the limit."""
    parts: list[dict[str, Any]]
    """The parts of the run's result that the limit changes, by their titles."""


class LinesOf(Body):
    """Lines of a scenario at once: of its steady state, or of the linearised drive."""

    scenario: Spec
    linear: bool = False


class LineNow(BaseModel):
    """A line [Hz, N m, 0-to-peak]."""

    line: str
    frequency: float
    amplitude: float


class LinesNow(BaseModel):
    """Lines; ``reason`` says why they are those of a run in time and not of a steady state."""

    lines: list[LineNow]
    reason: str


class RecordedMap(BaseModel):
    """Amplitudes over frequency [Hz] and time [s], the largest of each cell, in the unit of the analysis."""

    f: list[float]
    t: list[float]
    amplitude: list[list[float]]


class RecordedSpectrum(BaseModel):
    """A stretch of a recording's spectrum, in the unit of its analysis."""

    f: list[float]
    values: list[float]


Result = dict[str, Any]
