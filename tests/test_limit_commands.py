"""Limits over frequency on the command line: runs, their reports, rates, campaigns, recordings; loads."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from support.commands import SHORT, microvib
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.io.recordings import write_recording
from microvib.reports.figures import draw_first_page, governing_lines, spectrum_upper_end
from microvib.reports.run.lines import main_lines
from microvib.reports.sheets import svg
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.studies.campaign.results import open_results
from microvib.studies.campaign.statistics import (
    ABOVE,
    BELOW,
    UNKNOWN,
    case_verdicts,
    line_statistics,
)
from microvib.studies.rates import plan_rates
from microvib.studies.recording_limits import judge_recording
from microvib.testdata.recording import Recording
from microvib.units import Si

ROOT = Path(__file__).parents[1]
ALLOWED = "frequency_hz,t_mnm\n0.5,8\n10,8\n10,20\n40,80\n300,80\n"
STRICT = "frequency_hz,t_mnm\n0.5,8\n40,8\n60,8\n60,80\n300,80\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two curves, a run that is judged by one, and a recording."""
    made = tmp_path_factory.mktemp("limits")
    (made / "allowed.csv").write_text(ALLOWED)
    (made / "strict.csv").write_text(STRICT)
    command = ["run", "state-1", "--steady", "--limit", "allowed.csv", "--out", "judged"]
    done = microvib(*command, "--set", "record.duration=2 s", cwd=made)
    assert done.exit_code == 0, done.output
    assert ": pass; smallest margin " in " ".join(done.output.split())
    return made


def test_a_run_writes_its_margins_and_remembers_its_curve(folder):
    with (folder / "judged" / "margins.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    margins = [float(row["margin_db"]) for row in rows]
    assert margins == sorted(margins)
    assert min(margins) > 0.0
    curve = mv.read_limit(folder / "allowed.csv").curve
    for row in rows:
        f, a, allowed = (float(row[k]) for k in ("frequency_hz", "amplitude_n_m", "limit_n_m"))
        assert allowed == pytest.approx(curve.at(f), rel=1e-3)
        assert float(row["margin_db"]) == pytest.approx(20 * np.log10(allowed / a), abs=1e-6)
    summary = json.loads((folder / "judged" / "summary.json").read_text())
    assert summary["judgement"]["verdict"] == "pass"
    first = summary["judgement"]["curves"][0]["smallest_margins"][0]
    assert first["line"] == rows[0]["line"]
    assert mv.read_run(folder / "judged").limit == mv.read_limit(folder / "allowed.csv")


def test_a_report_takes_the_curve_again_or_another(folder):
    page = folder / "judged" / "report.html"
    for options, words in (
        ([], "Pass: "),
        (["--limit", "strict.csv"], "FAIL: 1 of "),
        (["--limit", "strict.csv", "--band", "61:200 Hz"], "Pass: "),
        (["--band", "1:100 Hz"], "Pass: "),
        (["--limit", "9 mN*m"], "FAIL: 2 of "),
    ):
        done = microvib("report", "judged", *options, cwd=folder)
        assert done.exit_code == 0, done.output
        assert words in page.read_text(encoding="utf-8"), options
    done = microvib("report", "judged", "--band", "500:600 Hz", cwd=folder)
    assert done.exit_code == 1
    assert "--band: 500 to 600 Hz has no part of the limit" in done.output


def test_what_is_no_curve_is_told_before_anything_is_computed(folder):
    (folder / "wrong.csv").write_text("frequency_hz,t_mnm\n1,5\n0.5,5\n")
    for command in (
        ["run", "state-1", "--out", "never"],
        ["rates", "state-1", "--from", "0.05 deg/s", "--to", "0.06 deg/s"],
        ["measure", "state-1", "-o", "never.csv"],
        ["report", "judged"],
    ):
        done = microvib(*command, "--limit", "wrong.csv", cwd=folder)
        assert done.exit_code == 1
        assert "goes from 1 Hz to 0.5 Hz" in done.output
        assert "Traceback" not in done.output
    assert not list(folder.glob("never*"))
    done = microvib("quiet", "state-1", "--limit", "allowed.csv", cwd=folder)
    assert done.exit_code == 1
    assert "is given as the objective" in done.output
    (folder / "loads.csv").write_text("frequency_hz,fx_mn\n1,5\n100,5\n")
    done = microvib(
        "rates", "state-1", "--from", "0.05 deg/s", "--to", "0.06 deg/s", "--limit", "loads.csv",
        cwd=folder,
    )  # fmt: skip
    assert "looks at the torque about the drive axis alone" in done.output


@pytest.fixture(scope="module")
def own_torque():
    """The torque of state 1 in its steady state, by a factor and with a little noise, as a recording."""
    state = mv.load_scenario("state-1", {"record.duration": "4 s"})
    motion = mv.simulate(state, start="steady")
    noise = np.random.default_rng(1).normal(0.0, 1e-6, motion["T_d"].size)

    def times(factor: float) -> Recording:
        channels = {"Mz": factor * motion["T_d"] + noise}
        return Recording(channels, motion.sample_rate, {"Mz": "N*m"}, "made")

    return times


@pytest.mark.parametrize(
    ("factor", "verdict"), [(1.0, "pass"), (1e-3, "not judged"), (-1.0, "pass"), (0.2, "pass")]
)
def test_a_recording_in_another_unit_passes_no_limit(own_torque, factor, verdict):
    """A quieter drive of another level passes, and a sign changes no amplitude."""
    recording, limit = own_torque(factor), limit_of(0.070, 5.0, 1000.0)
    assert judge_recording(recording, limit, scenario="state-1").verdict == verdict
    assert judge_recording(recording, limit).verdict == "pass"  # nothing says what it should be


def test_each_command_says_in_which_unit_a_recording_would_be_as_the_scenario(own_torque, tmp_path):
    write_recording(own_torque(1e-3), tmp_path / "own.mat")
    beside = ("--scenario", "state-1", "--limit", "70 mN*m", "--overwrite", "-o", "judged")
    for command in (("analyse", "own.mat"), ("compare", "own.mat", "own.mat"), ("envelope", "own.mat")):  # fmt: skip
        done = microvib(*command, *beside, cwd=tmp_path)
        assert done.exit_code == 0, done.output
        assert "multiplied by 1000 would be like B" in done.output, command


def test_recordings_are_judged_by_the_column_of_their_channel(folder):
    (folder / "six.csv").write_text("frequency_hz,mz_mnm,fx_mn\n5,8,1\n60,8,1\n60,80,1\n150,80,1\n")
    done = microvib("measure", "state-1", *SHORT, "--limit", "six.csv", "-o", "rec.csv", cwd=folder)
    assert done.exit_code == 0, done.output
    assert "Limit of Mz 8 to 80 mN m over frequency from 5 to 150 Hz: FAIL" in done.output
    assert "Limit of Fx 1 mN over frequency from 5 to 150 Hz" in done.output
    judged = ["analyse", "rec.csv", "--limit", "six.csv", "--out", "analysed", "--overwrite"]
    done = microvib(*judged, "--scenario", "state-1", cwd=folder)
    assert done.exit_code == 0, done.output
    assert "FAIL, 1 of " in done.output
    assert (
        (folder / "analysed" / "margins.csv").read_text().splitlines()[1].startswith("Mz,drive_1,")
    )
    done = microvib(*judged, "--limit-band", "61:150 Hz", cwd=folder)
    assert "Limit of Mz 80 mN m over frequency from 61 to 150 Hz: pass" in done.output
    done = microvib(*judged, "--channel", "Fy", cwd=folder)
    assert done.exit_code == 1
    assert "has nothing for the channel Fy [N]; it limits Mz, Fx" in done.output
    done = microvib("analyse", "state-1", "--limit", "six.csv", cwd=folder)
    assert "applies to recordings here" in done.output
    done = microvib("compare", "rec.csv", "rec.csv", "--limit", "six.csv", "--scenario", "state-1", cwd=folder)  # fmt: skip
    assert done.output.count("Limit of Mz 8 to 80 mN m over frequency") == 2


def test_rates_find_what_a_curve_forbids():
    limit = Limit.over_frequency(
        [("0.5 Hz", "8 mN*m"), ("40 Hz", "8 mN*m"), ("60 Hz", "80 mN*m"), ("400 Hz", "80 mN*m")]
    )
    rates = [f"{rate} deg/s" for rate in (0.03, 0.0596, 0.075)]
    plan = plan_rates("state-1", rates, limit=limit, linear=True)
    known = {case.rate: case for case in plan.cases}
    for case in known.values():
        worst = max((x.amplitude / limit.curve.at(x.frequency) for x in case.lines), default=0.0)
        assert 1.0 / plan.margin(case) == pytest.approx(worst, rel=2e-3)
        if worst > 1.01:
            assert "above the limit" in case.verdict(plan.band, plan.judged_by)
    assert plan.limit == 0.008
    flat = plan_rates("state-1", rates, limit=Limit(Si(0.008)), linear=True)
    as_before = plan_rates("state-1", rates, limit="8 mN*m", linear=True)
    assert flat.limit == as_before.limit
    assert flat.curve is None
    assert [b.why for b in flat.forbidden] == [b.why for b in as_before.forbidden]


def test_a_campaign_keeps_the_points_of_its_file_and_judges_cases_by_them(folder):
    (folder / "study.yaml").write_text(
        "{scenario: state-1, harmonics: 2, solve: steady, limit: strict.csv, band: '2:200 Hz',"
        " set: {record.duration: 1 s, record.sample_rate: 1024 Hz},"
        " vary: {driver.microsteps: [16, 32, 64]}}"
    )
    for command in (["create", "study.yaml", "batch"], ["run", "batch", "--workers", "1"]):
        done = microvib("campaign", *command, cwd=folder)
        assert done.exit_code == 0, done.output
    assert "strict.csv" not in (folder / "batch" / "study.yaml").read_text()
    done = microvib("campaign", "report", "batch", cwd=folder)
    assert done.exit_code == 0, done.output
    assert "8 to 80 mN m over frequency" in done.output
    from microvib.studies.campaign.folder import open_campaign

    results = open_results(open_campaign(folder / "batch"))
    band, own = (2.0, 200.0), mv.read_limit(folder / "strict.csv").curve
    scenario = mv.load_scenario("state-1").with_(
        {"record.duration": "1 s", "record.sample_rate": "1024 Hz"}
    )
    words = {"fail": ABOVE, "pass": BELOW, "not judged": UNKNOWN}
    expected = []
    for n in (16, 32, 64):
        one = scenario.with_({"driver.microsteps": n})
        table = mv.find_lines(one, harmonics=2, start="steady")
        limit = Limit.of_curves(own.within(*band))
        expected.append(words[judge(table, limit, one).verdict])
    assert case_verdicts(results, own, band).tolist() == expected
    assert len(set(expected)) > 1
    other = LimitCurve((2.0, 50.0, 200.0), (0.05, 0.04, 0.001))
    for row in line_statistics(results, other, band):
        if row.line in results.lines and row.frequency[0] == row.frequency[1]:
            above = row.largest > other.at(row.frequency[0])
            assert bool(row.above) == above
    results.dataset.close()
    done = microvib("campaign", "report", "batch", "--limit", "allowed.csv", cwd=folder)
    assert done.exit_code == 0, done.output


def test_loads_of_a_craft_are_judged_by_their_own_curves():
    result = mv.run_scenario(ROOT / "examples" / "spacecraft.yaml", start="steady", lines_only=True)
    assert result.hub is not None
    sizes = dict(zip(result.hub.names, np.abs(result.hub.loads), strict=True))
    by_load = {name: sizes["drive_1"][k] for k, name in enumerate(("Fx", "Fy", "Fz", "Mx", "My"))}
    shown = [name for name in ("Fx", "My") if by_load[name] > 1e-3]
    assert shown
    for name in shown:
        for factor, verdict in ((1.02, "pass"), (0.98, "fail")):
            level = factor * by_load[name]
            limit = Limit.of_curves(None, {name: LimitCurve.flat(level, 50.0, 60.0)})
            judged = result.judge(limit)
            assert judged.verdict == verdict, (name, factor, str(judged))
            [one] = judged.loads
            assert one.worst.line.name == "drive_1"
            assert one.worst.amplitude == pytest.approx(by_load[name], rel=1e-3)
    beyond = Limit.of_curves(None, {"Fx": LimitCurve.flat(1e3, 50.0, 1e5)})
    told = result.judge(beyond)
    assert told.verdict == "not judged"  # no model bounds a force above the passband


def test_a_spectrum_shows_the_curve_and_names_what_decides(motion_1, state_1):
    scenario = state_1.with_({"tracking.clock_ratio": 0.994})
    table = mv.find_lines(motion_1)
    rising = Limit.of_curves(LimitCurve((0.5, 50.0, 54.0, 300.0), (0.01, 0.02, 0.02, 0.1)))
    for limit, scale in ((rising, "log"), (Limit("20 mN*m", "0.5 Hz", "150 Hz"), "linear")):
        judged = judge(table, limit, scenario)
        named = governing_lines(judged)
        assert named[0] == "drive_1"
        assert len(named) == judged.above + 3
        drawing = draw_first_page(
            motion_1, table, spectrum_upper_end(main_lines(table, judged)), judged
        )
        ax = drawing.axes[0]
        assert ax.get_xscale() == scale
        texts = [text.get_text().split("\n")[0] for text in ax.texts]
        assert set(named[: judged.above]) <= set(texts)
        svg(drawing)
        drawing.draw_without_rendering()
        boxes = [text.get_window_extent() for text in ax.texts]
        legend = ax.get_legend().get_window_extent()
        first = texts.index("drive_1")
        assert not boxes[first].overlaps(legend)
    [line] = [x for x in ax.get_lines() if x.get_linestyle() == "--"]
    assert set(line.get_ydata()) == {20.0}
