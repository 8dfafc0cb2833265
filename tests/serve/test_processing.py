"""Recordings processed on the page: the same figures as the command line's, and no file that is named is opened."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.server import items, result, spec, wait

import microvib as mv
from microvib.io.band_limits import band_limits_from_text
from microvib.io.limit_files import limit_from_text
from microvib.io.recordings import Prepared, beside_background, write_recording
from microvib.studies.analyse import analyse
from microvib.studies.recording_limits import judge_recording
from microvib.studies.repeatability import RecordedRun, repeatability
from microvib.studies.track import track_orders
from microvib.testdata.recording import Recording
from microvib.testdata.section import Section

RATE = 600.0
BANDS = "low_hz,high_hz,limit_mn_m\n20,80,70\n80,150,5\n"


def a_test(seed: int = 1, size: float = 1.0, drive: bool = True) -> Recording:
    """Lines of state 1 in noise, with mains; its second half is larger."""
    t = np.arange(int(40 * RATE)) / RATE
    x = np.random.default_rng(seed).normal(0.0, 2e-4, t.size)
    x += 2e-3 * np.cos(2.0 * np.pi * 100.0 * t + seed)
    if drive:
        f_d = mv.load_scenario("state-1").driving_frequency
        x += size * np.where(t < 20.0, 0.04, 0.06) * np.cos(2.0 * np.pi * f_d * t)
    return Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "test")


def tone() -> np.ndarray:
    """The driving line of state 1 with an amplitude of 1, in noise."""
    t = np.arange(int(20 * RATE)) / RATE
    f_d = mv.load_scenario("state-1").driving_frequency
    noise = np.random.default_rng(4).normal(0.0, 2e-3, t.size)
    return np.cos(2.0 * np.pi * f_d * t) + noise


def sweep(ratio: float = 1.004) -> Recording:
    """Orders 1 and 4 of 10 to 40 revolutions per second in 5 s, the clock a little off."""
    t = np.arange(3001) / RATE
    turns = ratio * (10.0 * t + 3.0 * t**2)
    x = 0.01 * np.random.default_rng(1).normal(size=t.size)
    x += 0.5 * np.cos(2.0 * np.pi * turns) + 1.2 * np.cos(8.0 * np.pi * turns)
    return Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "sweep")


def sent(client, recording: Recording, folder: Path, name: str) -> str:
    write_recording(recording, folder / name)
    content = (folder / name).read_bytes()
    answer = client.post("/api/recordings", params={"name": name}, content=content)
    assert answer.status_code == 200, answer.text
    return answer.json()["id"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("processing")


@pytest.fixture(scope="module")
def test_id(client, folder) -> str:
    return sent(client, a_test(), folder, "test.mat")


@pytest.fixture(scope="module")
def off(client, folder) -> str:
    return sent(client, a_test(7, drive=False), folder, "off.mat")


@pytest.fixture(scope="module")
def sweep_id(client, folder) -> str:
    return sent(client, sweep(), folder, "sweep.mat")


def started(client, path: str, **asked) -> dict:
    answer = client.post(f"/api/{path}", json=asked)
    assert answer.status_code == 202, answer.text
    id = answer.json()["id"]
    return {"id": id, **result(client, id)}


def refused(client, path: str, **asked) -> dict:
    answer = client.post(f"/api/{path}", json=asked)
    assert answer.status_code == 422, answer.text
    return answer.json()


def test_a_section_is_processed_as_the_command_line_does(client, test_id):
    asked = {"from": "20 s", "to": "40 s", "average": "peak-hold", "resolution": "1 Hz"}
    asked |= {"overlap": 0.75, "window": "flat-top"}
    found = started(client, "analyses", recording=test_id, scenario=spec(), **asked)
    expected = analyse(
        a_test(), scenario=mv.load_scenario("state-1"), section=Section.stated("20 s", "40 s"),
        average="peak-hold", resolution="1 Hz", overlap=0.75, window="flat-top",
    )  # fmt: skip
    assert found["section"] == [20.0, 40.0]
    assert found["spectrum"]["made"] == str(expected.spectrum)
    assert "peak hold" in found["spectrum"]["made"]
    assert max(found["spectrum"]["amplitude"]) == expected.spectrum.amplitude.max()
    drive = next(line for line in found["lines"] if line["line"] == "drive_1")
    assert drive["amplitude_n_m"] == expected.table["drive_1"].amplitude
    assert drive["amplitude_n_m"] == pytest.approx(0.06, rel=0.01)  # 0.05 over both halves
    map_ = client.get(f"/api/analyses/{found['id']}/waterfall").json()
    assert map_["t"][0] >= 20.0
    assert np.max(map_["amplitude"]) == pytest.approx(expected.waterfall.amplitude.max(), rel=1e-3)
    part = {"from": 45, "to": 60, "begin": 25, "end": 30}
    zoomed = client.get(f"/api/analyses/{found['id']}/waterfall", params=part).json()
    assert 45 <= zoomed["f"][0] <= zoomed["f"][-1] <= 60
    assert 25 <= zoomed["t"][0] <= zoomed["t"][-1] <= 30


def test_a_trigger_begins_a_section(client, test_id):
    asked = {"trigger": "Mz > 55 mN*m", "pre_trigger": "1 s", "to": "10 s"}
    found = started(client, "analyses", recording=test_id, scenario=spec(), **asked)
    start, stop = found["section"]
    assert start == pytest.approx(19.0, abs=0.05)
    assert stop - start == pytest.approx(11.0)
    never = {"trigger": "Mz > 1 N*m"}
    id = client.post(
        "/api/analyses", json={"recording": test_id, "scenario": spec(), **never}
    ).json()["id"]
    assert "trigger: Mz never rises through 1 N*m" in wait(client, id)["error"]


@pytest.mark.parametrize(
    ("asked", "key"),
    [
        ({"from": "2"}, "from"),
        ({"from": "-2 s"}, "from"),
        ({"from": "1 s", "trigger": "Mz > 1 N*m"}, "from"),
        ({"pre_trigger": "1 s"}, "pre_trigger"),
        ({"trigger": "Mz"}, "trigger"),
        ({"overlap": 1.0}, "overlap"),
        ({"average": "median"}, "average"),
        ({"roll_off": 0.1}, "roll_off"),
        ({"bands": "private.csv"}, None),
        ({"bands": "low_hz,high_hz,limit_mn_m\n5,1,3"}, None),
        ({"limit": "private.csv"}, "limit"),
        ({"limit": "60 s"}, "limit"),
        ({"limit_band": "1:2 Hz"}, "limit_band"),
        ({"limit": "60 mN*m", "limit_band": "1 Hz"}, "limit_band"),
    ],
)
def test_options_that_are_none(client, test_id, asked, key):
    said = refused(client, "analyses", recording=test_id, scenario=spec(), **asked)
    assert said["key"] == key
    assert said["error"]


def said_of(found: dict, title: str) -> list[str]:
    """Texts of the part of an answer that has a title."""
    part = next(part for part in found["parts"] if part["title"] == title)
    return [one["text"] for one in items(part, "text")]


CURVE = "frequency_hz,t_mnm\n1,200\n52.9,200\n52.95,45\n53.05,45\n53.1,200\n150,200\n"
"""A limit with a notch about the driving line of state 1, which has 50 mN m there."""


def test_lines_are_judged_as_the_command_line_does(client, test_id):
    asked = {"recording": test_id, "scenario": spec(), "from": "20 s", "to": "40 s"}
    found = started(client, "analyses", **asked, limit=CURVE)
    later, _ = Section.stated("20 s", "40 s").cut(a_test())
    expected = judge_recording(later, limit_from_text(CURVE), scenario="state-1")
    assert expected.verdict == "fail"
    assert found["limit"]["text"] == str(expected)
    assert found["limit"]["verdict"] == "fail"
    assert found["limit"]["margins"][0] == {"line": "drive_1", "verdict": "fail"}
    assert found["limit"]["curve"] == [
        [f, pytest.approx(a)] for f, a in expected.limit.as_dict()["curve"]
    ]
    assert said_of(found, "Against the limit") == [str(expected)]
    assert found["facts"][0]["value"] == f"FAIL: 1 of {len(expected.margins)} lines"
    assert found["facts"][0]["status"] == "fail"
    above = started(client, "analyses", **asked, limit=CURVE, limit_band="60:150 Hz")
    assert above["limit"]["verdict"] != "fail"
    assert above["limit"]["low"] == 60.0
    assert started(client, "analyses", **asked)["limit"] is None


def test_several_recordings_are_judged(client, test_id, folder):
    half = sent(client, a_test(3, size=0.5), folder, "half.mat")
    asked = {"recordings": [test_id, half], "scenario": spec(), "from": "20 s", "to": "40 s"}
    both = started(client, "batches", **asked, limit=CURVE)
    (pairs,) = items(both["parts"][0], "pairs")
    rows = dict(pairs["rows"])
    assert rows["Record 1"] == "test.mat, channel Mz, FAIL"
    assert "FAIL" not in rows["Record 2"]
    steady = [mv.Recording({"Mz": 0.03 * k * tone()}, RATE, {"Mz": "N*m"}, f"{k}") for k in (1, 2)]
    ids = [sent(client, one, folder, f"steady-{one.title}.mat") for one in steady]
    two = started(
        client, "comparisons", recording=ids[1], other=ids[0], scenario=spec(), limit=CURVE
    )
    said = said_of(two, "Against the limit")
    assert len(said) == 2
    assert "FAIL" in said[0]
    assert "FAIL" not in said[1]


def test_background_and_mains_are_marked(client, test_id, off):
    found = started(client, "analyses", recording=test_id, scenario=spec(), background=off)
    expected = analyse(
        beside_background(a_test(), a_test(7, drive=False)), scenario=mv.load_scenario("state-1")
    )
    assert found["background"]
    [line] = found["background_lines"]
    assert line["mains"] == "2 x 50 Hz"
    assert line["amplitude_n_m"] == expected.background_lines[0].amplitude
    mine = client.get(f"/api/analyses/{found['id']}/spectrum", params={"of": "background"}).json()
    assert max(mine["values"]) == pytest.approx(2e-3, rel=0.05)
    assert any("Lines with the drive off" in part["title"] for part in found["parts"])
    alone = started(client, "analyses", recording=test_id, scenario=spec())
    assert not alone["background"]
    there = client.get(f"/api/analyses/{alone['id']}/spectrum", params={"of": "background"})
    assert there.status_code == 404
    other = client.post("/api/analyses", json={"recording": test_id, "scenario": spec(), "background": "0" * 16})  # fmt: skip
    assert other.status_code == 404


def test_bands_have_their_time_histories(client, test_id):
    asked = {"from": "20 s", "bands": BANDS}
    found = started(client, "analyses", recording=test_id, scenario=spec(), **asked)
    section, _ = Section.stated("20 s").cut(a_test())
    limits = band_limits_from_text(BANDS)
    expected = analyse(section, scenario=mv.load_scenario("state-1"), band_limits=limits).band_peaks
    assert [band["verdict"] for band in found["bands"]] == [one.verdict for one in expected]
    assert [band["verdict"] for band in found["bands"]] == ["pass", "not judged"]
    assert (
        "far less" in expected[1].why
        or "shows none" in expected[1].why
        or "behind" in expected[1].why
    )
    for k, (band, one) in enumerate(zip(found["bands"], expected, strict=True)):
        assert band["peak"] == one.peak
        begin, end = band["span"]
        assert 20.0 < begin < band["time"] < end < 40.0
        seen = client.get(f"/api/analyses/{found['id']}/bands/{k}").json()
        most = max(max(map(abs, seen["min"])), max(map(abs, seen["max"] or seen["min"])))
        assert most == pytest.approx(one.peak, rel=0.02)  # the peak is read between samples, too
    assert client.get(f"/api/analyses/{found['id']}/bands/2").status_code == 404
    assert found["verdict"] == "not judged"
    tight = started(client, "analyses", recording=test_id, scenario=spec(), bands=BANDS.replace("70", "30"))  # fmt: skip
    assert tight["verdict"] == "fail"


def test_orders_are_tracked_as_the_command_line_does(client, sweep_id):
    limit = "frequency_hz,t_mnm\n5,700\n30,700\n30,400\n200,400"
    asked = {"orders": "1,4", "profile": "0 s:10 Hz, 5 s:40 Hz"}
    found = started(client, "trackings", recording=sweep_id, limit=limit, **asked)
    expected = track_orders(sweep(), [1, 4], profile=asked["profile"])
    for cut, one in zip(found["cuts"], expected.cuts, strict=True):
        assert cut["label"] == one.label
        assert cut["amplitude"] == pytest.approx(one.amplitude, rel=1e-4)
        assert cut["limit"] is not None
    assert np.mean(found["clock"]) == pytest.approx(0.004, abs=5e-4)  # looked for in the record
    assert found["verdict"] == "fail"
    rows = items(next(p for p in found["parts"] if p["title"] == "Against the limit"), "table")[0][
        "rows"
    ]
    assert {row["order"]: row["finding"] for row in rows}["4"] == "above the limit"
    assert np.shape(found["order_map"]["amplitude"])[1] == len(found["order_map"]["order"])
    map_ = client.get(f"/api/analyses/{found['id']}/waterfall").json()
    assert np.shape(map_["amplitude"]) == (len(map_["t"]), len(map_["f"]))
    table = "time [s],speed [rpm]\n0,600\n5,2400\n"
    same = started(client, "trackings", recording=sweep_id, orders="1,4", profile=table)
    assert [cut["amplitude"] for cut in same["cuts"]] == [cut["amplitude"] for cut in found["cuts"]]


def test_a_sweep_that_stays_below_a_limit_passes_nothing(client, sweep_id):
    asked = {"orders": "1,4", "strongest": 4, "limit": "3 N*m", "from": "0.5 s"}
    found = started(client, "trackings", recording=sweep_id, **asked)
    assert found["verdict"] == "not judged"
    part = next(p for p in found["parts"] if p["title"] == "Against the limit")
    assert "That is no pass" in items(part, "text")[0]["text"]
    assert found["cuts"][0]["time"][0] >= 0.5


@pytest.mark.parametrize(
    ("asked", "key", "words"),
    [
        ({"orders": "one"}, "orders", "not a list of orders"),
        ({}, "reference", "given: none"),
        ({"profile": "0 s:10 Hz", "tacho": "Mz"}, "reference", "given: profile, tacho"),
        ({"profile": "0 s:10 Hz", "limit": "allowed.csv"}, "limit", "no files are opened"),
        ({"profile": "0 s:10 Hz", "from": "x"}, "from", "from"),
    ],
)
def test_sweeps_that_are_none(client, sweep_id, asked, key, words):
    said = refused(client, "trackings", **{"recording": sweep_id, "orders": "1,4", **asked})
    assert (said["key"], words in said["error"]) == (key, True), said


def test_no_profile_is_a_file(client, sweep_id, tmp_path):
    """Not even one that is there."""
    (tmp_path / "profile.csv").write_text("time [s],speed [Hz]\n0,10\n5,40\n")
    asked = {"recording": sweep_id, "orders": "1,4", "profile": str(tmp_path / "profile.csv")}
    id = client.post("/api/trackings", json=asked).json()["id"]
    assert "no files are opened here" in wait(client, id)["error"]


def test_two_recordings_are_compared_with_hints(client, test_id, folder):
    turned = a_test(2)
    other = sent(client, Recording({"Mz": 1e3 * turned["Mz"]}, RATE, {"Mz": "N*m"}), folder, "test.csv")  # fmt: skip
    found = started(client, "comparisons", recording=test_id, other=other, scenario=spec())
    said = " ".join(x["text"] for x in items(found["parts"][0], "text"))
    assert "mN" in said  # the other is as if in another unit
    assert found["summary"] == "B against A: test.csv (recording) against test.mat (recording)."
    assert refused(client, "comparisons", recording=test_id)["key"] == "run"
    both = {"recording": test_id, "other": other, "run": "0" * 16}
    assert refused(client, "comparisons", **both)["key"] == "run"


def test_repeated_tests_and_several_recordings(client, test_id, folder):
    ids = [test_id]
    ids += [sent(client, a_test(k, 1.0 + 0.01 * k), folder, f"{k}.mat") for k in (2, 3)]
    tests = [{"recording": id, "unit": "A"} for id in ids]
    found = started(client, "repeated", tests=tests, scenario=spec())
    runs = [
        RecordedRun(name, Prepared(a_test(k, 1.0 + (0.01 * k if k > 1 else 0.0))), "A")
        for k, name in enumerate(("test.mat", "2.mat", "3.mat"), 1)
    ]
    expected = repeatability(runs, scenario="state-1")
    assert len(expected.lines) == 1
    assert found["summary"] == "3 runs of 1 unit, 1 line."
    table = next(
        items(part, "table")[0] for part in found["parts"] if part["title"] == "Lines of Mz"
    )
    [row], [mine] = table["rows"], expected.lines
    assert row["line"] == mine.line
    assert float(row["mean_n_m"]) == pytest.approx(1e3 * mine.mean, rel=1e-3)
    asked = {"recordings": ids, "scenario": spec(), "from": "20 s"}
    batch = started(client, "batches", **asked)
    assert [one["name"] for one in batch["spectra"]] == ["test.mat", "2.mat", "3.mat"]
    rows = next(items(part, "table")[0]["rows"] for part in batch["parts"] if part["title"] == "Figures of all records")  # fmt: skip
    assert any(float(row["records"]) == 3 for row in rows)
    one = {"recordings": [test_id, test_id], "scenario": spec()}
    assert refused(client, "batches", **one)["key"] == "recordings"


def test_the_unit_of_a_channel_is_stated_where_a_file_has_none(client, folder):
    """As of sound files, whose samples are parts of full scale."""
    from scipy.io import wavfile

    x = a_test()["Mz"]
    wavfile.write(folder / "test.wav", int(RATE), (x / 0.5).astype(np.float32))
    content = (folder / "test.wav").read_bytes()
    kept = client.post("/api/recordings", params={"name": "test.wav"}, content=content).json()
    [channel] = kept["channels"]
    asked = {"recording": kept["id"], "channel": channel["name"], "scenario": spec()}
    id = client.post("/api/analyses", json=asked).json()["id"]
    assert "full scale" in wait(client, id)["error"]
    found = started(client, "analyses", **asked, **{"unit": "0.5 N*m", "from": "20 s"})
    drive = next(line for line in found["lines"] if line["line"] == "drive_1")
    assert drive["amplitude_n_m"] == pytest.approx(0.06, rel=0.01)
    id = client.post("/api/analyses", json={**asked, "unit": "furlong"}).json()["id"]
    assert "furlong" in wait(client, id)["error"]
