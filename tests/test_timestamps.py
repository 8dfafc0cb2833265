"""Recordings whose time axis is of dates and times of day, and samples that stand alone."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pytest

import microvib as mv
from microvib.io.recordings import load_preparation, read_prepared
from microvib.testdata.recording import RecordingError

RATE, SAMPLES = 4096.0, 5000
SMOOTH = np.sin(2.0 * np.pi * 53.0 * np.arange(SAMPLES) / RATE)


def written(
    path: Path,
    head: str,
    form: str,
    start: str = "2024-03-05T10:15:30",
    zone: str = "",
    decimal: str = ".",
    cut: int = 0,
    scale: str = "1",
) -> Path:
    """A text file of SMOOTH with times in the ``form`` of strftime and its separator at the end, ``cut`` digits left out."""
    first, rows = datetime.datetime.fromisoformat(start), [head]
    for k, x in enumerate(SMOOTH):
        time = (first + datetime.timedelta(seconds=k / RATE)).strftime(form[:-1])
        rows.append(
            f"{time[: len(time) - cut]}{zone}{form[-1]}{float(scale) * x:.9f}".replace(".", decimal)
        )
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize(
    ("head", "form", "keys"),
    [
        ("Timestamp,Mz [N*m]", "%Y-%m-%dT%H:%M:%S.%f,", {}),
        ("Time,Mz [N*m]", "%Y-%m-%d %H:%M:%S.%f,", {"zone": "Z"}),
        ("time [hh:mm:ss],Mz [N*m]", "%H:%M:%S.%f,", {"zone": "+01:00"}),
        ('"Date","Time","Mz [N*m]"', '"%Y-%m-%d","%H:%M:%S.%f",', {}),
        ("Date,Time,Mz\n,,N*m", "%d-%b-%Y,%H:%M:%S.%f,", {}),
        ("Uhrzeit;Mz [N*m]", "%H:%M:%S.%f;", {"decimal": ","}),
        ("Datum;Uhrzeit;Mz [N*m]", "%Y/%m/%d;%H:%M:%S.%f;", {"decimal": ","}),
        ("Date\tTime\tMz [N*m]", "%m/%d/%Y\t%I:%M:%S.%f %p\t", {"start": "2024-03-05T11:59:59.5"}),
        ("Date Time Mz", "%Y-%m-%d %H:%M:%S.%f ", {}),
        ("Time Mz", "%H:%M:%S.%f ", {"scale": "1234.5"}),
        ("Time Mz", "%Y-%m-%dT%H:%M:%S.%f ", {}),
        ("Time,Mz [N*m]", "%d.%m.%Y %H:%M:%S.%f,", {"start": "2024-12-31T23:59:59.5"}),
        ("Time,Mz [N*m]", "%H:%M:%S.%f,", {"start": "2024-12-31T23:59:59.5"}),
        ("Time,Mz [N*m]", "%M:%S.%f,", {}),
    ],
)
def test_dates_and_times_of_day_are_seconds_from_the_first(
    tmp_path: Path, head: str, form: str, keys: dict[str, str]
) -> None:
    found = mv.read_recording(written(tmp_path / "a.csv", head, form, **keys))  # type: ignore[arg-type]
    assert found.sample_rate == RATE
    assert [*found.channels] == ["Mz"]
    assert found["Mz"] == pytest.approx(float(keys.get("scale", 1)) * SMOOTH, abs=1e-8)
    assert found.notes[0].startswith("time is counted from '")


def test_times_of_few_digits_need_the_rate(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Time,Mz [N*m]", "%Y-%m-%d %H:%M:%S.%f,", cut=3)
    with pytest.raises(
        RecordingError, match=r"too few digits to tell the samples apart, about 4\d\d\d in a second"
    ):
        mv.read_recording(path)
    assert mv.read_recording(path, "4096 Hz").samples == SAMPLES
    with pytest.raises(RecordingError, match="too few digits"):
        mv.read_recording(path, "5000 Hz")


def test_times_that_contradict_themselves_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Time,Mz [N*m]", "%Y-%m-%d %H:%M:%S.%f,")
    good = path.read_text().splitlines()
    other_day, no_day = good[2000].replace("03-05", "03-06"), good[2000].replace("2024-03-05 ", "")
    for rows, told in (
        (
            [*good[:2000], other_day, *good[2001:]],
            "row 2000 of its numbers is of '2024-03-06.*; a day is missing or twice",
        ),
        (
            [*good[:2000], no_day, *good[2001:]],
            "row 2000 of its numbers has no time such as '2024-03-05 10:15:30.000000'",
        ),
        (
            [*good[:2000], *good[1999:]],
            "1 of its samples have the time of the one before, the first at 0.487793",
        ),
    ):
        path.write_text("\n".join(rows) + "\n")
        for rate in (None, "4096 Hz"):
            with pytest.raises(RecordingError, match=told):
                mv.read_recording(path, rate)
    path.write_text("\n".join(good[:2000] + good[2001:]) + "\n")
    with pytest.raises(RecordingError, match="about 1 samples are missing"):
        mv.read_recording(path, "4096 Hz")


def with_glitch(size: float, width: int = 1) -> np.ndarray:
    x = SMOOTH + np.random.default_rng(3).normal(0.0, 0.01, SAMPLES)
    x[2048 : 2048 + width] += size
    return x


@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_sample_that_stands_alone_is_told(width: int) -> None:
    found = mv.Recording({"Mz": with_glitch(60.0, width)}, RATE, {"Mz": "N*m"})
    assert "channel Mz has an isolated outlier sample at 0.5" in found.notes_on("Mz")[-1]
    assert found.notes_on("Mz")[-1].endswith("typical of a glitch; it stays in")


def test_what_rings_steps_or_is_noise_does_not_stand_alone() -> None:
    t = np.arange(SAMPLES) / RATE
    blow = np.where(
        t > 0.5, 60.0 * np.exp(-40.0 * (t - 0.5)) * np.sin(2.0 * np.pi * 700.0 * (t - 0.5)), 0.0
    )
    for x in (
        with_glitch(0.0),
        with_glitch(0.0) + blow,
        with_glitch(0.0) + 60.0 * (t > 0.5),
        with_glitch(60.0, 40),
    ):
        assert mv.Recording({"Mz": x}, RATE, {"Mz": "N*m"}).notes_on("Mz") == ()


def test_a_glitch_is_told_whatever_the_preparation_does(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "time [s],CH1 [N*m]\n"
        + "".join(f"{k / RATE:.9f},{x:.9f}\n" for k, x in enumerate(with_glitch(60.0)))
    )
    told = []
    for how in ("detrend: 1\ndecimate: 4\n", "start: 0.6 s\n"):
        (tmp_path / "how.yaml").write_text("channels: {Mz: -CH1}\n" + how)
        told.append(
            read_prepared(
                tmp_path / "a.csv", load_preparation(tmp_path / "how.yaml")
            ).recording.notes_on("Mz")
        )
    assert "has an isolated outlier sample at 0.5 s: -60" in told[0][-1]
    assert "stands alone" not in "".join(told[1])
