"""Windows of long records for a screen: no sample is lost, and what is kept is never another file's."""

from __future__ import annotations

import os
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import microvib as mv
from microvib.io import browse as browsing
from microvib.io.browse import browse
from microvib.io.recordings import write_recording
from microvib.io.scenario_file import load_bench
from microvib.signals.pyramid import Pyramid
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import RecordingError


@pytest.fixture
def cache(tmp_path, monkeypatch):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"):
        monkeypatch.setenv(name, str(tmp_path / "cache"))
    return tmp_path / "cache"


def kept(cache, ending):
    return sorted(cache.rglob(f"*{ending}"))


@settings(max_examples=200, deadline=None)
@given(
    samples=st.integers(1, 40_000),
    t0=st.floats(-10.0, 60.0),
    width=st.floats(1e-3, 80.0),
    pixels=st.integers(1, 400),
    seed=st.integers(0, 100),
)
def test_no_sample_of_a_window_is_lost(samples, t0, width, pixels, seed):
    rng = np.random.default_rng(seed)
    x, rate = rng.normal(size=samples), 1000.0
    curve = Pyramid.of(x, rate).window(t0, t0 + width, pixels)
    first, last = (
        max(int(np.ceil(t0 * rate)), 0),
        min(int(np.floor((t0 + width) * rate)), samples - 1),
    )
    if first > last:
        return
    inside = x[first : last + 1]
    assert curve.low.min() <= inside.min()
    assert curve.high.max() >= inside.max()
    assert curve.time.size == curve.low.size == curve.high.size
    assert curve.time.size <= max(pixels, 2 * pixels + 2 if curve.of_samples else 0)
    assert np.all(np.diff(curve.time) > 0.0)
    # every group holds what is drawn of it, and nothing from further away than a quarter of a pixel
    starts = np.rint(curve.time * rate).astype(int)
    ends = np.append(starts[1:], min(last + 1 + round(width * rate / pixels) + 1, samples))
    for a, b, low, high in zip(starts[:50], ends[:50], curve.low, curve.high, strict=False):
        assert low == x[a:b].min() or b == ends[-1]
        assert high == x[a:b].max() or b == ends[-1]
    slack = max(width * rate / pixels / 4.0, 1.0) + 1.0
    assert starts[0] >= first - slack


def test_what_is_no_number_is_passed_over():
    x = np.sin(np.arange(100_000) / 100.0)
    x[5000] = np.nan
    x[20_000:60_000] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        curve = Pyramid.of(x, 1000.0).window(0.0, 100.0, 100)
    assert np.all(np.isnan(curve.low[25:55]))
    assert not np.any(np.isnan(curve.low[:19]))


def made(tmp_path, seed=0, samples=200_000):
    file = tmp_path / "long.mat"
    rng = np.random.default_rng(seed)
    x = rng.normal(size=samples)
    write_recording(mv.Recording({"Mz": x, "Fx": 2.0 * x}, 4096.0, {"Mz": "N*m", "Fx": "N"}), file)
    return file, x


def test_a_recording_is_read_once(tmp_path, cache, monkeypatch):
    file, x = made(tmp_path)
    first = browse(file)
    assert first.channels == ["Mz", "Fx"]
    assert first.units == {"Mz": "N*m", "Fx": "N"}
    one = first.window("Fx", 0.0, first.duration, 300)
    assert one.high.max() == 2.0 * x.max()
    assert [path.parent.name for path in kept(cache, ".samples")] == ["browse"]
    assert not [path for path in tmp_path.iterdir() if path.name not in ("long.mat", "cache")]

    def not_again(*_):
        raise AssertionError("the file is read again")

    monkeypatch.setattr(browsing, "read_prepared", not_again)
    second = browse(file)
    again = second.window("Fx", 0.0, second.duration, 300)
    assert np.array_equal(again.low, one.low)
    assert second.duration == first.duration
    near = second.window("Fx", 1.0, 1.01, 300)
    assert near.of_samples
    assert np.array_equal(near.low, 2.0 * x[4096:4138])


def test_a_file_that_changed_is_read_again(tmp_path, cache):
    file, x = made(tmp_path)
    browse(file).window("Mz", 0.0, 10.0, 100)
    status = file.stat()
    file.unlink()
    _, other = made(tmp_path, seed=1)
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))  # same path, size and time
    assert file.stat().st_size == status.st_size
    curve = browse(file).window("Mz", 0.0, 60.0, 100)
    assert curve.high.max() == other.max() != x.max()


def test_another_preparation_is_another_recording(tmp_path, cache):
    file, x = made(tmp_path)
    plain = browse(file).window("Mz", 0.0, 60.0, 100)
    cut = browse(file, Preparation(channels={"Mz": "-Mz"}))
    assert cut.window("Mz", 0.0, 60.0, 100).high.max() == -x.min() != plain.high.max()
    table = Preparation(bench=load_bench("force-table"))
    assert browse(file, table).samples == x.size


@pytest.mark.parametrize("damage", ["cut", "emptied", "head"])
def test_what_is_kept_but_damaged_is_made_again(tmp_path, cache, damage):
    file, x = made(tmp_path)
    browse(file).window("Mz", 0.0, 60.0, 100)
    [path] = kept(cache, ".samples")
    content = path.read_bytes()
    changed = {"cut": content[:-8], "emptied": b"", "head": b"?" * len(content)}[damage]
    path.write_bytes(changed)
    assert browse(file).window("Mz", 0.0, 60.0, 100).high.max() == x.max()
    assert path.read_bytes() == content


def test_without_a_cache_it_works_all_the_same(tmp_path, cache, monkeypatch):
    monkeypatch.setattr(browsing, "_folder", lambda: None)
    file, x = made(tmp_path)
    assert browse(file).window("Mz", 0.0, 60.0, 100).high.max() == x.max()
    assert not kept(cache, ".samples")


def test_the_cache_does_not_grow_without_end(tmp_path, cache, monkeypatch):
    monkeypatch.setattr(browsing, "LARGEST_CACHE", 5_000_000)
    for k in range(5):
        folder = tmp_path / f"{k}"
        folder.mkdir()
        file, _ = made(folder, seed=k)
        browse(file).window("Mz", 0.0, 60.0, 100)
    assert 1 <= len(kept(cache, ".samples")) <= 2
    assert browse(file).window("Mz", 0.0, 60.0, 100).time.size == 100


def test_a_channel_or_file_that_is_not_there(tmp_path, cache):
    file, _ = made(tmp_path)
    with pytest.raises(RecordingError, match="there is no channel 'Mx'; there are Mz, Fx"):
        browse(file).window("Mx", 0.0, 1.0, 10)
    with pytest.raises(RecordingError, match="cannot be read"):
        browse(tmp_path / "none.mat")
