"""Readings corrected for the dynamics of their force table: back within 2 % below half of its first resonance, and
refused where the response does not tell.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.io
from support.scenarios import in_si

import microvib as mv
from microvib.analysis.lines import lines_of_recording
from microvib.io.recordings import load_preparation, read_prepared, write_recording
from microvib.io.scenario_file import load_bench
from microvib.io.table_responses import read_table_response, table_response_csv
from microvib.io.uff_writing import Dataset58, Place, write_datasets
from microvib.model.rigid import COMPONENTS
from microvib.signals.line_table import BEYOND_RESPONSE
from microvib.signals.spectrum import tone_amplitude
from microvib.studies.measure import measure as measure_scenario
from microvib.testdata.bench import Bench, Mounted, Resonance, measure
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.table_correction import TableFrf, without_table_dynamics
from microvib.testdata.table_response import TableResponse, modelled_response

RATE, DURATION = 2048.0, 8.0
TONES = np.array([11.3, 37.9, 71.2, 99.6, 139.4, 188.8])
RESONANCE = 300.0
AVERAGES = 10


def bench_with(frequency=RESONANCE, damping=0.02, **more) -> Bench:
    table = tuple(
        in_si(Resonance, component=c, frequency=frequency, damping=damping) for c in COMPONENTS
    )
    return in_si(Bench, sample_rate=RATE, duration=DURATION, lead=2.0).model_copy(
        update={"table": table, **more}
    )


def recorded(bench: Bench) -> Recording:
    """Six components, each with all tones of an amplitude of its own, as a bench reads them."""
    n = math.ceil(bench.span * bench.analog_rate)
    t = np.arange(n) / bench.analog_rate
    x = np.sum(np.cos(2.0 * np.pi * TONES[:, None] * t + np.arange(TONES.size)[:, None]), axis=0)
    return measure(bench, np.outer(amplitudes(), x), np.zeros(n))


def amplitudes() -> np.ndarray:
    return np.array([0.2, 0.3, 0.1, 0.01, 0.02, 0.03])


def response_of(bench: Bench, coherence=0.99, first=2.0, last=600.0, step=0.5) -> TableResponse:
    """As a hammer test would have it: bins, coherences, and nothing said of resonances."""
    exact = modelled_response("modelled", bench.loaded_table)
    f = np.arange(first, last, step)
    H = np.full((f.size, 6, 6), np.nan, dtype=complex)
    s = 2j * np.pi * f
    for k, one in enumerate(bench.loaded_table):
        w = 2.0 * np.pi * one.frequency
        H[:, k, k] = w * w / (s * s + 2.0 * one.damping * w * s + w * w)
    assert exact.first_resonance("Mz") == bench.loaded_table[5].frequency
    spread = np.sqrt((1.0 - coherence) / (2.0 * (AVERAGES - 1) * coherence)) * np.abs(H)
    return TableResponse("frf", f, H, spread, np.full((f.size, 6), coherence))


HERE = TableFrf.model_construct(
    file="frf.csv",
    mounted_mass=0.0,
    test_mass=0.0,
    table_mass=None,
    uncertainty=None,
    averages=None,
)


def corrected(response: TableResponse, bench: Bench | None = None, **how) -> Recording:
    return without_table_dynamics(
        recorded(bench or bench_with()), response, HERE.model_copy(update=how)
    )


def status_at(recording: Recording, frequency: float, channel: str = "Mz") -> tuple[str, float]:
    """Status and amplitude of the line nearest to a frequency."""
    table = lines_of_recording(recording, channel, None)
    line = min(table, key=lambda x: abs(x.place - frequency))
    assert abs(line.place - frequency) < 0.05
    return line.status, line.amplitude


@pytest.mark.parametrize("seed", range(4))
def test_a_run_through_the_bench_comes_back_within_2_percent_below_half_the_resonance(seed):
    """Drawn resonances and damping; as recorded, the same lines are up to a third off."""
    rng = np.random.default_rng(seed)
    bench = bench_with(rng.uniform(220.0, 700.0), 10.0 ** rng.uniform(-2.5, -1.0))
    exact, first = amplitudes()[5], bench.table[5].frequency
    raw, back = recorded(bench), corrected(response_of(bench, last=1000.0), bench)
    worst = 0.0
    for f in TONES:
        status, amplitude = status_at(back, f)
        if f < 0.5 * first * 0.995:
            assert status == "ok"
            assert amplitude == pytest.approx(exact, rel=0.02)
            worst = max(worst, abs(tone_amplitude(raw["Mz"], RATE, f) / exact - 1.0))
        elif f > 0.5 * first * 1.005:
            assert status == BEYOND_RESPONSE
    assert worst > 0.05


def test_a_simulated_run_through_the_bench_comes_back(tmp_path):
    """The catalog's bench with a soft table, as files: recording, preparation, lines."""
    scenario = mv.load_scenario("state-1")
    bench = load_bench("force-table")
    soft = tuple(
        one.model_copy(update={"frequency": 300.0}) if one.component == "Mz" else one
        for one in bench.table
    )
    bench = bench.model_copy(update={"table": soft})
    write_recording(measure_scenario(scenario, bench), tmp_path / "run.uff")
    text = table_response_csv(response_of(bench_with(300.0, bench.table[5].damping)))
    (tmp_path / "frf.csv").write_text(text)
    how = "table_frf: {file: frf.csv, mounted_mass: 40 kg, test_mass: 40 kg}\n"
    (tmp_path / "how.yaml").write_text(how)
    prepared = read_prepared(tmp_path / "run.uff", load_preparation(tmp_path / "how.yaml"))
    table = lines_of_recording(prepared.recording, "Mz", scenario)
    truth = mv.find_lines(mv.simulate(scenario, channels=("T_d",)))
    for name in ("drive_1", "drive_2"):
        assert table[name].status == "ok"
        assert table[name].amplitude == pytest.approx(truth[name].amplitude, rel=0.02)
    for name in ("drive_3", "drive_4"):
        assert table[name].status == BEYOND_RESPONSE
    found = mv.compare(prepared, scenario)
    verdicts = {row.line: row.verdict for row in found.rows}
    assert verdicts["drive_3"] == verdicts["drive_4"] == "not judged"
    assert verdicts["drive_2"] != "not judged"


def test_phases_come_back_too():
    bench = bench_with(damping=0.1)
    n = math.ceil(bench.span * bench.analog_rate)
    t = np.arange(n) / bench.analog_rate
    load = np.cos(2.0 * np.pi * 120.0 * t)
    raw = measure(bench, np.tile(load, (6, 1)), np.zeros(n))
    back = without_table_dynamics(raw, response_of(bench), HERE)
    at = round(bench.lead * RATE)
    exact = load[:: round(bench.analog_rate / RATE)][at : at + raw.samples]
    inner = slice(2000, -2000)
    assert np.max(np.abs(raw["Mz"] - exact)[inner]) > 0.2
    assert np.max(np.abs(back["Mz"] - exact)[inner]) < 0.005


def test_the_uncertainty_of_the_response_is_that_of_the_lines():
    """Responses drawn about the truth: errors of the lines over their uncertainties have a spread of one."""
    exact, coherence = response_of(bench_with(), 0.99), 0.99
    part = math.sqrt((1.0 - coherence) / (2.0 * (AVERAGES - 1) * coherence))
    rng, over = np.random.default_rng(5), []
    raw = recorded(bench_with())
    for _ in range(12):
        noise = rng.normal(size=exact.H.shape) + 1j * rng.normal(size=exact.H.shape)
        drawn = replace(exact, H=exact.H * (1.0 + part * noise))
        back = without_table_dynamics(raw, drawn, HERE)
        for line in lines_of_recording(back, "Mz", None):
            near = np.abs(TONES - line.frequency)
            if line.seen and np.min(near) < 0.01:
                over.append((line.amplitude - amplitudes()[5]) / line.amplitude_uncertainty)
    assert len(over) >= 50
    # a tone lies between two bins, whose noise is averaged: its error is at most the bins'
    assert 0.5 < float(np.std(over)) < 1.15


def test_what_the_response_does_not_cover_is_not_judged():
    back = corrected(response_of(bench_with(), first=25.0))
    assert status_at(back, 11.3)[0] == BEYOND_RESPONSE
    assert status_at(back, 37.9)[0] == "ok"
    assert back.table.objection("Mz", 11.3) == "frf begins at 25 Hz"
    low = corrected(
        response_of(bench_with(), last=200.0)
    )  # whose resonance is not seen: half of what is covered
    assert status_at(low, 99.6)[0] == "ok"
    assert status_at(low, 139.4)[0] == BEYOND_RESPONSE


def test_where_coherence_is_low_or_the_response_unsure_nothing_is_judged():
    response = response_of(bench_with())
    response.coherence[(response.frequency > 65.0) & (response.frequency < 75.0)] = 0.5
    response.uncertainty[(response.frequency > 95.0) & (response.frequency < 105.0)] *= 5.0
    back = corrected(response)
    assert status_at(back, 71.2)[0] == status_at(back, 99.6)[0] == BEYOND_RESPONSE
    assert status_at(back, 37.9)[0] == status_at(back, 139.4)[0] == "ok"
    assert "coherence of frf is 0.50" in back.table.objection("Mz", 71.2)
    assert "uncertainty of frf is" in back.table.objection("Mz", 99.6)


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1e3, "readings in mN over loads in N"),
        (1e-3, "readings in N over loads in mN"),
        (-1.0, "its sign is reversed"),
        (9.80665, "kgf for N"),
        (1.5, "check units, sign and channel"),
    ],
)
def test_a_response_in_another_unit_is_refused(factor, told):
    response = response_of(bench_with())
    with pytest.raises(RecordingError, match=told):
        corrected(replace(response, H=factor * response.H))


def test_a_hammer_s_calibration_does_not_scale_the_readings():
    response = response_of(bench_with())
    back = corrected(replace(response, H=1.04 * response.H))
    assert status_at(back, 99.6)[1] == pytest.approx(amplitudes()[5], rel=0.005)
    assert any("1.04" in note for note in back.notes_on("Mz"))


@pytest.mark.parametrize("factor", [0.97, 1.04])
def test_a_line_allows_for_a_calibration_that_is_the_hammer_s_or_the_table_s(factor):
    """Readings are the loads where the hammer is wrong, and that many times the loads where the table is."""
    response = response_of(bench_with())
    back = corrected(replace(response, H=factor * response.H))
    line = min(lines_of_recording(back, "Mz", None), key=lambda x: abs(x.place - 99.6))
    least, most = (line.amplitude + k * 2.0 * line.amplitude_uncertainty for k in (-1.0, 1.0))
    assert least < amplitudes()[5] / factor < most
    assert least < amplitudes()[5] < most


@pytest.mark.parametrize(("corner", "judged"), [(600.0, True), (200.0, False)])
def test_a_low_pass_of_the_hammer_s_channel_is_told_by_its_phase(corner, judged):
    """What it takes of the hammer is no part of the table: amplitudes are off by 3 and 20 % at 139 Hz."""
    response = response_of(bench_with())
    low_pass = 1.0 / (1.0 + 1j * response.frequency / corner)
    back = corrected(replace(response, H=response.H / low_pass[:, None, None]))
    line = min(lines_of_recording(back, "Mz", None), key=lambda x: abs(x.place - 139.4))
    assert (line.status != BEYOND_RESPONSE) == judged
    if judged:
        assert line.amplitude + 2.0 * line.amplitude_uncertainty > amplitudes()[5] > line.amplitude


def test_nothing_is_judged_by_a_response_that_is_far_from_1_at_low_frequencies():
    response = response_of(bench_with())
    back = corrected(replace(response, H=0.85 * response.H))
    assert status_at(back, 99.6)[0] == BEYOND_RESPONSE


def test_a_response_under_another_mass_is_said_and_counted():
    """The table was empty in the hammer test: the resonance fell from 300 to 212 Hz under the drive."""
    table = tuple(
        in_si(Resonance, component=c, frequency=300.0, damping=0.02, **{key: 20.0})
        for c in COMPONENTS
        for key in ["table_mass" if c[0] == "F" else "table_inertia"]
    )
    empty = bench_with().model_copy(update={"table": table})
    loaded = empty.model_copy(
        update={"mounted": in_si(Mounted, mass=20.0, inertia=(20.0, 20.0, 20.0))}
    )
    response = response_of(empty)
    back = corrected(response, loaded, test_mass=20.0)
    assert any("WARNING" in note and "20 kg" in note for note in back.notes)
    for f in TONES:
        assert (
            status_at(back, f)[0] == BEYOND_RESPONSE
        )  # empty to 20 kg, and the table's own mass is not stated
    known = corrected(response, loaded, test_mass=20.0, table_mass=20.0)
    for line in lines_of_recording(known, "Mz", None):
        if line.seen and np.min(np.abs(TONES - line.frequency)) < 0.05:
            assert abs(line.amplitude - amplitudes()[5]) < 2.0 * line.amplitude_uncertainty
    assert status_at(known, 11.3)[0] == "ok"
    assert status_at(known, 139.4)[0] == BEYOND_RESPONSE  # beyond half of 212 Hz
    same = corrected(response_of(loaded), loaded, mounted_mass=20.0, test_mass=20.0)
    assert status_at(same, 99.6)[1] == pytest.approx(amplitudes()[5], rel=0.005)
    assert not any("WARNING" in note for note in same.notes)


def test_a_coupled_response_takes_cross_talk_out_and_its_uncertainty_with_it():
    rng, bench = np.random.default_rng(2), bench_with()
    C = np.eye(6) + 0.08 * rng.normal(size=(6, 6)) * (1.0 - np.eye(6))
    coupled = bench.model_copy(update={"cross_talk": tuple(map(tuple, C.tolist()))})
    response = response_of(bench)
    H = np.einsum("ij,fj->fij", C, np.einsum("fjj->fj", response.H))
    full = replace(response, H=H, uncertainty=0.005 * np.abs(H))
    raw = recorded(coupled)
    back = without_table_dynamics(raw, full, HERE)
    assert abs(tone_amplitude(raw["Mz"], RATE, 99.6) / amplitudes()[5] - 1.0) > 0.2
    table = lines_of_recording(back, "Mz", None)
    line = min(table, key=lambda x: abs(x.place - 99.6))
    assert line.amplitude == pytest.approx(amplitudes()[5], rel=0.01)
    # forces ten times as large come in by cross-talk of some per cent, of which half a per cent is not known
    expected = 0.005 * math.sqrt(
        sum(
            abs(np.linalg.inv(C)[5, j]) ** 2
            * sum(abs(C[j, k] * amplitudes()[k]) ** 2 for k in range(6))
            for j in range(6)
        )
    )
    assert line.amplitude_uncertainty == pytest.approx(expected, rel=0.19)


def test_moved_torques_take_the_uncertainty_of_forces_along():
    from microvib.testdata.moved import with_moved_torques

    back = with_moved_torques(corrected(response_of(bench_with())), (0.5, 0.0, 0.0))
    part = math.sqrt(0.01 / (2.0 * 9.0 * 0.99))  # sqrt((1-c)/(2(n-1)c)), c = 0.99, n = 10
    fy, mz = amplitudes()[1], amplitudes()[5]
    spread = back.table.amplitude_uncertainty("Mz", 99.6, 0.1)
    assert spread == pytest.approx(part * math.hypot(mz, 0.5 * fy), rel=0.19)


@pytest.mark.parametrize("ending", ["uff", "csv", "mat"])
def test_responses_are_read_from_files(tmp_path, ending):
    response, path = response_of(bench_with()), tmp_path / f"frf.{ending}"
    f = response.frequency
    if ending == "csv":
        path.write_text(table_response_csv(response))
    elif ending == "mat":
        scipy.io.savemat(path, {"frequency": f, "H": response.H})
    else:
        sets = [
            Dataset58(
                "H1", 4, response.diagonal(c), f, *_units(c), Place(1, k), Place(1, k), _units(c)[0]
            )
            for k, c in enumerate(COMPONENTS, 1)
        ]
        sets.append(
            Dataset58("coh", 6, response.coherence[:, 5], f, "", "", Place(1, 6), Place(1, 6))
        )
        write_datasets(path, sets)
    back = read_table_response(path)
    np.testing.assert_allclose(back.frequency, f)
    np.testing.assert_allclose(back.diagonal("Mz"), response.diagonal("Mz"), rtol=1e-8)
    assert back.known == COMPONENTS
    if ending != "mat":
        np.testing.assert_allclose(back.coherence[:, 5], 0.99)
    if ending != "csv":  # which has uncertainties
        with pytest.raises(RecordingError, match=r"table_frf\.uncertainty, such as 1 percent"):
            corrected(back)
        assert status_at(corrected(back, uncertainty=0.01), 99.6)[0] == "ok"


def _units(component: str) -> tuple[str, str]:
    return ("N" if component[0] == "F" else "N*m"), "made"


def test_an_accelerance_is_no_response_of_readings(tmp_path):
    f = np.arange(1.0, 100.0)
    one = Dataset58("Fz", 4, f * (1 + 0j), f, "m/s^2", "", Place(1, 3), Place(1, 3), "N")
    write_datasets(tmp_path / "a.uff", [one])
    with pytest.raises(RecordingError, match="no accelerance"):
        read_table_response(tmp_path / "a.uff")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("table_frf: {file: frf.csv}", "mounted_mass: missing, in kg"),
        ("table_frf: {mounted_mass: 3 kg}", "goes with file"),
        ("table_frf: {measured: 3}", "put here by reading"),
        ("table_frf: {file: nothing.csv, mounted_mass: 0 kg, test_mass: 0 kg}", "nothing.csv"),
    ],
)
def test_a_wrong_preparation_is_a_sentence(tmp_path, text, told):
    (tmp_path / "how.yaml").write_text(text)
    (tmp_path / "frf.csv").write_text(table_response_csv(response_of(bench_with())))
    with pytest.raises(mv.MicrovibError, match=told):
        load_preparation(tmp_path / "how.yaml")


def test_a_missing_component_is_not_judged_and_said():
    response = response_of(bench_with())
    response.H[:, 0, 0] = np.nan
    back = corrected(response)
    assert status_at(back, 37.9, "Mz")[0] == "ok"
    assert "no response of Fx" in back.table.objection("Fx", 37.9)
    assert back.table.unusable("Fx")[0].low == 0.0
