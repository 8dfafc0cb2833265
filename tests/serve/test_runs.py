"""A run on the page has the numbers, verdicts and files of the command line."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from support.scenarios import limit_of
from support.server import LONG, SHORT, result, start, wait

import microvib as mv
from microvib.analysis.reference import compare_with_reference
from microvib.analysis.run import RunResult
from microvib.io.writing import RUN_FILES
from microvib.reports.outcome import page_answer
from microvib.reports.run.folder import run_to_folder
from microvib.reports.run.outcome import run_outcome
from microvib.signals.screen import decimate_spectrum
from microvib.solve.channels import CHANNELS
from microvib.web.routes import results
from microvib.web.routes.results import series


def test_a_run_gives_the_numbers_of_the_command_line(client, finished, tmp_path):
    run_to_folder(mv.load_scenario("state-1", SHORT), tmp_path / "run", lines_only=True)
    text = (tmp_path / "run" / "lines.csv").read_text()
    assert client.get(f"/api/runs/{finished}/files/lines.csv").text == text
    rows = {row["line"]: row for row in csv.DictReader(io.StringIO(text))}
    for line in result(client, finished)["lines"]:
        for column in ("frequency_hz", "amplitude_n_m", "phase_rad", "bin_amplitude_n_m"):
            shown = "" if line[column] is None else f"{line[column]:.9g}"
            assert shown == rows[line["line"]][column]


def test_a_run_has_the_reference_lines_of_its_scenario(client, finished, motion):
    found, table = result(client, finished), mv.find_lines(motion)
    rows = compare_with_reference(motion.scenario, table)
    assert [row["line"] for row in found["measured"]] == [row.line for row in rows] != []
    assert found["measured"][0]["measured_n_m"] == rows[0].measured_amplitude
    [part] = [part for part in found["parts"] if part["title"] == "Beside measured lines"]
    text, shown = part["items"]
    assert "Appl. Sci. 2021, 11, 9076, Tables 5 and 6" in text["text"]
    assert "nearest bin" in text["text"]
    assert [row["line"] for row in shown["rows"]] == [row.line for row in rows]


def test_the_drive_train_balances(client, finished, motion):
    found = result(client, finished)["drivetrain"]
    power = found["power"]
    stored = power["kinetic"] + power["magnetic"] + power["elastic"]
    spent = power["joule"] + power["friction"] + power["damping"] + stored
    assert power["electrical"] == pytest.approx(spent, rel=1e-3)
    assert found["T_d"]["peak"] == np.abs(motion["T_d"]).max()
    assert found["i_rms"] == pytest.approx(0.6 / np.sqrt(2), rel=0.01)  # sine of 0.6 A
    torques = {row["torque"]: row for row in result(client, finished)["budget"]}
    drive_1 = mv.find_lines(motion)["drive_1"]
    assert torques["T_d"]["drive_1_amplitude"] == pytest.approx(drive_1.amplitude, rel=1e-3)
    assert torques["T_d"]["drive_1_phase"] == pytest.approx(drive_1.phase, abs=1e-2)
    assert found["stuck_output"] == motion["stuck_output"].mean()


def test_series_are_exact_where_every_sample_is_there(client, finished, motion):
    query = {"channels": "T_d,i_A", "from": 1.5, "to": 1.6, "points": 2000}
    found = client.get(f"/api/runs/{finished}/series", params=query).json()
    keep = (motion.time >= 1.5) & (motion.time <= 1.6)
    assert found["exact"]
    assert found["t"] == motion.time[keep].tolist()
    for name in ("T_d", "i_A"):
        assert (
            found["channels"][name]["min"]
            == found["channels"][name]["max"]
            == motion[name][keep].tolist()
        )
    assert found["channels"]["T_d"]["unit"] == "N*m"


@pytest.mark.parametrize("points", [2, 37, 1000, 16_383, 16_384])
def test_no_peak_is_lost_at_any_zoom(client, finished, motion, points):
    found = client.get(
        f"/api/runs/{finished}/series", params={"channels": "T_d", "points": points}
    ).json()
    assert len(found["t"]) <= points
    assert max(found["channels"]["T_d"]["max"]) == motion["T_d"].max()
    assert min(found["channels"]["T_d"]["min"]) == motion["T_d"].min()
    assert np.all(np.diff(found["t"]) > 0.0)


def test_the_last_samples_are_in_the_last_group():
    x = np.zeros(1003)
    x[-1] = 5.0
    found = series({"T_d": x}, 0.0, 100.0, None, None, 10)
    assert found["channels"]["T_d"]["max"][-1] == 5.0
    assert found["to"] == 10.02


def test_a_thinned_spectrum_keeps_its_peaks_at_their_frequency(client, finished, motion):
    whole = mv.spectrum(motion, window="hann")
    k = int(np.argmax(whole.amplitude))
    found = client.get(f"/api/runs/{finished}/spectrum", params={"points": 50}).json()
    assert len(found["f"]) <= 50
    assert found["amplitude"][int(np.argmax(found["amplitude"]))] == whole.amplitude[k]
    assert whole.frequency[k] in found["f"]
    part = client.get(
        f"/api/runs/{finished}/spectrum", params={"from": 50, "to": 60, "window": "rectangular"}
    ).json()
    assert 50 <= min(part["f"]) < max(part["f"]) <= 60


def test_a_thinned_spectrum_has_no_plateaus_on_a_logarithmic_axis():
    """A tone between two decades: few points at low frequencies would draw a level line from it to its neighbours."""
    f = np.arange(200_000) / 100.0
    y = np.where(np.abs(f - 1.19) < 0.005, 1.0, 1e-6)
    shown, values = decimate_spectrum(f, y, 4000, log=True)
    assert np.array_equal(shown[shown < 3.0], f[f < 3.0])
    assert (values == 1.0).sum() == 1
    thinned, low = decimate_spectrum(f, np.abs(np.sin(f)) + 1e-6, 1000)
    assert thinned.size <= 1000
    assert np.median(low) < 0.75  # the smallest are there beside the largest


def test_a_verdict_is_that_of_the_report(client, finished, motion):
    from microvib.analysis.limits import judge

    table = mv.find_lines(motion)
    for query, limit in (
        ({"limit": "30 mN*m"}, limit_of(0.03)),
        ({"limit": "30 mN*m", "band": "0.5:5 Hz"}, limit_of(0.03, 0.5, 5.0)),
    ):
        judged = judge(table, limit, motion.scenario)
        found = client.get(f"/api/runs/{finished}/verdict", params=query).json()
        assert found["text"] == str(judged)
        assert found["verdict"] == judged.verdict
        assert [m["line"] for m in found["margins"]] == [m.line.name for m in judged.margins]
        shown = page_answer(run_outcome(RunResult.of_motion(motion, table), limit))
        first, lines = found["parts"]
        assert [first["title"], lines] == ["", shown["parts"][1]]
        assert found["facts"] == shown["facts"]
    page = client.get(f"/api/runs/{finished}/files/report.html", params={"limit": "30 mN*m"}).text
    assert "limit 30" in page
    assert "limit 30" not in client.get(f"/api/runs/{finished}/files/report.html").text
    wrong = client.get(f"/api/runs/{finished}/verdict", params={"limit": "30 kg"})
    assert wrong.status_code == 422
    assert wrong.json()["key"] == "limit"


def test_a_limit_over_frequency_is_the_text_of_its_table_and_never_a_file(
    client, finished, motion, tmp_path
):
    from microvib.analysis.limits import judge
    from microvib.io.limit_files import limit_from_text

    table, text = mv.find_lines(motion), "frequency_hz,t_mnm\n1,8\n40,8\n60,80\n100,80\n"
    query = {"limit": text, "band": "2:90 Hz"}
    judged = judge(table, limit_from_text(text).within("2:90 Hz"), motion.scenario)
    found = client.get(f"/api/runs/{finished}/verdict", params=query).json()
    assert found["text"] == str(judged)
    assert [point[0] for point in found["curve"]] == [2.0, 40.0, 60.0, 90.0]
    assert [part["title"] for part in found["parts"]][2] == "Against the limit"
    page = client.get(f"/api/runs/{finished}/files/report.html", params=query).text
    assert "over frequency" in page
    (tmp_path / "allowed.csv").write_text(text)
    for wrong in (str(tmp_path / "allowed.csv"), "frequency_hz,t_mnm\n1,x\n2,5", "a\nb"):
        refused = client.get(f"/api/runs/{finished}/verdict", params={"limit": wrong})
        assert refused.status_code == 422
        assert refused.json()["key"] == "limit"


def test_jobs_that_are_asked_for(client, finished):
    assert [
        job["id"]
        for job in client.get("/api/jobs", params={"ids": f"{finished},{'0' * 16}"}).json()
    ] == [finished]
    assert client.get("/api/jobs", params={"ids": ""}).json() == []
    assert finished in [job["id"] for job in client.get("/api/jobs").json()]


def test_an_answer_about_jobs_waits_for_one_that_has_not_ended(client, finished, monkeypatch):
    goes_on = start(client, LONG)
    asked = {"ids": goes_on, "wait": 50}
    assert client.get("/api/jobs", params=asked).json()[0]["state"] in ("queued", "running")
    monkeypatch.setattr(results, "_LOOK_AGAIN", 1e6)  # s: who waits now does not come back
    for other in (finished, "0" * 16):
        asked = {"ids": f"{goes_on},{other}", "wait": 1000}
        assert goes_on in [job["id"] for job in client.get("/api/jobs", params=asked).json()]
    client.delete(f"/api/jobs/{goes_on}")
    wait(client, goes_on, "cancelled")
    assert client.get("/api/jobs", params={"ids": goes_on, "wait": 1001}).status_code == 422


def test_files_of_a_run(client, finished):
    assert mv.Scenario  # the scenario reads back to the same
    text = client.get(f"/api/runs/{finished}/files/scenario.yaml").text
    assert text == mv.dump_scenario(mv.load_scenario("state-1", SHORT))
    netcdf = client.get(f"/api/runs/{finished}/files/motion.nc")
    assert netcdf.content[:4] == b"\x89HDF"
    assert "attachment" in netcdf.headers["content-disposition"]
    assert "drive_1" in client.get(f"/api/runs/{finished}/files/report.html").text
    assert client.get(f"/api/runs/{finished}/files/report.pdf").content.startswith(b"%PDF")
    for name in ("report.exe", "result.json", "run.pickle", "..%2F..%2Fetc%2Fpasswd"):
        assert client.get(f"/api/runs/{finished}/files/{name}").status_code == 404


def test_a_steady_run_says_that_it_is_steady(client):
    run = start(client, {**SHORT, "record.settle": "0 s"}, steady=True)
    found = result(client, run)
    lines = {line["line"]: line for line in found["lines"]}
    assert lines["array_mode_1"]["status"] == "not in a steady state"
    simulated = dict(found["parts"][0]["items"][0]["rows"])
    assert simulated["Steady state"].startswith("repeats every ")
    report = client.get(f"/api/runs/{run}/files/report.html").text
    assert "deviations fall to" in report  # as in the command line's
    assert "start: steady" in client.get(f"/api/runs/{run}/files/scenario.yaml").text


def test_events_tell_how_far_a_run_is(client):
    id = start(client, {"record.settle": "60 s", "record.duration": "4 s"})
    states = [
        json.loads(line[6:])
        for line in client.get(f"/api/jobs/{id}/events").text.splitlines()
        if line
    ]
    assert states[-1]["state"] == "done"
    done = [s["progress"]["done"] for s in states if s["progress"]["unit"] == "s"]
    assert done == sorted(done)
    assert states[-1]["progress"]["total"] == pytest.approx(64.0, abs=0.1)


def test_channels_of_the_page_are_those_of_a_motion(client, finished):
    assert [c["name"] for c in result(client, finished)["channels"]] == list(CHANNELS)


def test_the_page_offers_every_file_of_a_run():
    offered = (Path(results.__file__).parents[1] / "static" / "run.js").read_text(encoding="utf-8")
    for name in RUN_FILES:
        if name != "motion_wing_2.nc":  # the page keeps the first drive's channels
            assert name in results.FILES
            assert f'["{name}"' in offered


COMPILED = ("fmu2", "fmu3", "wasm")
"""Formats for which a compiler runs for seconds; `c` is made by the same one."""


@pytest.mark.release
def test_a_run_in_the_formats_that_a_compiler_makes(client, finished):
    """tests/export runs the functions that make them."""
    offered = {one["target"]: one for one in result(client, finished)["exports"]}
    for target in COMPILED:
        for name in offered[target]["files"]:
            answer = client.get(f"/api/runs/{finished}/exports/{name}")
            assert answer.status_code == 200, name
            assert name in answer.headers["content-disposition"]


def test_a_run_in_the_formats_of_other_tools(client, finished, tmp_path):
    found = result(client, finished)
    offered = {one["target"]: one for one in found["exports"]}
    assert set(COMPILED) < set(offered)
    assert offered["source-sheet"]["missing"].startswith("array.rigid_body: missing")
    for target, one in offered.items():
        for name in one["files"] if target not in COMPILED else ():
            answer = client.get(f"/api/runs/{finished}/exports/{name}")
            if one["missing"]:
                assert (answer.status_code, target) == (422, "source-sheet")
                assert "array.rigid_body: missing" in answer.text
                continue
            assert answer.status_code == 200, name
            assert name in answer.headers["content-disposition"]
            (tmp_path / name).write_bytes(answer.content)
    recording = mv.read_recording(tmp_path / "mat.mat")
    kept = mv.simulate(mv.load_scenario("state-1", SHORT))
    assert recording.channels["T_d"].size == kept["T_d"].size
    assert b"RLOAD1" in (tmp_path / "nastran.bdf").read_bytes()


def test_options_of_a_format(client, finished):
    """As the command takes them; each choice is a file of its own, and what is wrong is a sentence."""
    where = f"/api/runs/{finished}/exports/nastran.bdf"
    plain = client.get(where).text
    asked = [("option", "grid=77"), ("option", "contents=[lines]")]
    chosen = client.get(where, params=asked).text
    assert "at grid point 77:" in chosen
    assert "RANDPS" not in chosen
    assert "at grid point 1:" in plain
    assert client.get(where).text == plain
    assert client.get(where, params=[("option", "grid=1")]).text == plain
    for option, said in (
        ("grid=0", "nastran: grid: 0 is not allowed; a whole number from 1"),
        ("grids=1", "nastran: grids: unknown key; did you mean grid"),
        ("grid", "option grid: KEY=VALUE is expected"),
    ):
        answer = client.get(where, params={"option": option})
        assert answer.status_code == 422
        assert answer.json()["error"].startswith(said), answer.text
    (one,) = [x for x in result(client, finished)["exports"] if x["target"] == "nastran"]
    shown = {option["key"]: option for option in one["options"]}
    assert shown["units"]["choices"] == ["SI", "mm-t-s", "mm-kg-s", "in-lbf-s", "ft-lbf-s"]
    assert shown["contents"]["kind"] == "choices"
    assert shown["grid"]["default"] == "1"


def test_no_other_file_is_exported(client, finished):
    for name in ("mat", "mat.exe", ".mat", "nastran.bdf.mat", "..%2Frun.pickle", "csv.csv%00"):
        answer = client.get(f"/api/runs/{finished}/exports/{name}")
        assert answer.status_code == 404, name
    assert client.get(f"/api/runs/{'0' * 16}/exports/mat.mat").status_code == 404
