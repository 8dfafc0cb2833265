"""Universal files: datasets 58 of every form, as programs write them and mangle them."""

import struct

import numpy as np
import pytest

from microvib.io.recordings import read_recording
from microvib.testdata.recording import RecordingError, require_usable_channel

RATE = 4096.0
T = np.arange(2048) / RATE
MZ = 0.05 * np.cos(2 * np.pi * 53 * T) + np.random.default_rng(0).normal(0, 1e-3, T.size)
SINGLE = MZ.astype(np.float32).astype(float)


def dataset(values=MZ, name="Mz", *, kind=4, binary="", function=1, node=1, direction=6, entity="NONE", along=17, step=1 / RATE,
            unit="N*m", axis="s", even=True, x=T, end="\n", before="", said=None, label="NONE", form=2, mark=None):  # fmt: skip
    """One dataset 58 in columns, as bytes."""
    parts = 2 if kind in (5, 6) else 1
    size = 4 if kind in (2, 5) else 8
    numbers = (
        np.column_stack([np.real(values), np.imag(values)])
        if parts == 2
        else np.asarray(values)[:, None]
    )
    first = f"{'58':>6}"
    if binary:
        mark = mark or binary
        own = [("x", f"{mark}f4")] if not even else []
        table = np.zeros(len(numbers), np.dtype([*own, ("y", f"{mark}f{size}", (parts,))]))
        table["y"] = numbers
        if not even:
            table["x"] = x
        body = table.tobytes()
        count = len(body) if said is None else said
        first += (
            f"b{1 if binary == '<' else 2:6d}{form:6d}{11:12d}{count:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        )
    else:
        width = "{:13.5E}" if size == 4 else "{:20.11E}"
        columns = [[width.format(v) for v in row] for row in numbers]
        flat = [
            (f"{t:13.5E}" if not even else "") + "".join(c)
            for t, c in zip(x[: len(values)], columns, strict=True)
        ]
        a_line = (6 if size == 4 else 4) // parts if even else 1
        body = "".join(
            "".join(flat[k : k + a_line]) + end for k in range(0, len(flat), a_line)
        ).encode()
    head = [
        "    -1", first, name, "NONE", "05-MAR-24 10:15:30", "NONE", "NONE",
        f"{function:5d}{0:10d}{0:5d}{0:10d} {entity:10}{node:10d}{direction:4d} {'NONE':10}{0:10d}{0:4d}",
        f"{kind:10d}{len(values):10d}{int(even):10d}{0:13.5E}{step if even else 0:13.5E}{0:13.5E}",
        f"{along:10d}{0:5d}{0:5d}{0:5d} {label:20} {axis:20}",
        f"{13:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {unit:20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {'NONE':20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {'NONE':20}",
    ]  # fmt: skip
    return (end.join(head) + end).encode() + body + before.encode() + b"    -1" + end.encode()


def read(tmp_path, *sets, name="test.unv"):
    path = tmp_path / name
    path.write_bytes(b"".join(sets))
    return read_recording(path)


FORMS = {
    "text": {},
    "text, single": {"kind": 2},
    "text, CR LF": {"end": "\r\n"},
    "text, uneven": {"even": False},
    "little endian": {"binary": "<"},
    "big endian": {"binary": ">"},
    "single, little": {"binary": "<", "kind": 2},
    "single, big": {"binary": ">", "kind": 2},
    "end on a line of its own": {"binary": "<", "before": "\n"},
    "end after CR LF": {"binary": "<", "before": "\r\n", "end": "\r\n"},
    "no count of bytes": {"binary": "<", "said": 0},
    "another byte order than it says": {"binary": "<", "mark": ">"},
    "single, another byte order": {"binary": ">", "mark": "<", "kind": 2},
    "uneven, binary": {"binary": "<", "even": False},
    "milliseconds": {"axis": "ms", "step": 1e3 / RATE},
    "upper case": {"axis": "SEC"},
}


@pytest.mark.parametrize("form", FORMS.values(), ids=list(FORMS))
def test_every_form_of_a_dataset_is_read(tmp_path, form):
    uneven = {"x": T.astype(np.float32)} if not form.get("even", True) else {}
    found = read(tmp_path, dataset(**form, **uneven), dataset(-MZ, "My", **form, **uneven))
    assert found.sample_rate == pytest.approx(RATE, rel=1e-5)
    require_usable_channel(found, "Mz")
    tolerance = 1e-6 if form.get("kind") == 2 else 1e-9
    np.testing.assert_allclose(found["Mz"], MZ, atol=tolerance)
    np.testing.assert_allclose(found["My"], -MZ, atol=tolerance)


def test_an_end_within_binary_numbers_is_none(tmp_path):
    """Bytes that read as the end of a dataset are a number among others."""
    looks = struct.unpack("<d", b"    -1\n ")[0]
    x = MZ.copy()
    x[700] = looks
    data = dataset(x, binary="<")
    assert b"    -1\n" in data[200:-20]
    assert read(tmp_path, data)["Mz"].size == 2048


def test_numbers_that_run_together_and_exponents_of_fortran_are_read(tmp_path):
    data = dataset(-np.abs(SINGLE), kind=2)
    head = b"\n".join(data.split(b"\n")[:13])
    body = data[len(head) : -8].replace(b" -", b"-").replace(b"E-0", b"D-0")
    assert read(tmp_path, head, body, data[-8:])["Mz"] == pytest.approx(-np.abs(SINGLE), abs=1e-6)


@pytest.mark.parametrize("label", ["NONE", "Time Record", "Mz"])
def test_channels_that_share_a_first_line_are_told_apart_by_node_and_direction(tmp_path, label):
    found = read(
        tmp_path,
        dataset(MZ, label, node=7, direction=6),
        dataset(2 * MZ, label, node=7, direction=-3, unit="N"),
    )
    stem = "" if label == "NONE" else f"{label} "
    assert list(found.channels) == [f"{stem}7:+RZ", f"{stem}7:-Z"]
    assert found[f"{stem}7:+RZ"] == pytest.approx(MZ, abs=1e-9)
    assert f"channel {stem}7:-Z: measured against its direction" in found.notes
    with pytest.raises(RecordingError, match="occurs twice"):
        read(tmp_path, dataset(MZ, label, node=7), dataset(2 * MZ, label, node=7))


def test_a_first_line_of_its_own_is_the_name(tmp_path):
    assert list(read(tmp_path, dataset(), dataset(MZ, "Fx", unit="N")).channels) == ["Mz", "Fx"]


def test_a_frequency_response_beside_time_histories_is_left_out_and_named(tmp_path):
    h = dataset(MZ[:400] + 1j * MZ[:400], "H1", kind=6, function=4, along=18, axis="Hz", step=1.0)
    found = read(tmp_path, dataset(), h, dataset(MZ, "Fx", unit="N"))
    assert list(found.channels) == ["Mz", "Fx"]
    assert "channel H1 is not a time history but a frequency response function" in " ".join(
        found.notes
    )
    with pytest.raises(
        RecordingError, match="channel H1 is not a time history but a frequency response function"
    ):
        read(tmp_path, h)


@pytest.mark.parametrize(
    "form",
    [{"along": 18, "axis": "Hz"}, {"along": 18, "axis": "NONE"}, {"along": 19, "axis": "NONE"}, {"along": 1, "axis": "Hz"},
     {"along": 0, "axis": "NONE", "label": "Frequency"}, {"along": 8, "axis": "NONE"}, {"function": 12}],
)  # fmt: skip
def test_abscissae_that_are_not_time_are_refused(tmp_path, form):
    with pytest.raises(RecordingError, match="not a time history"):
        read(tmp_path, dataset(**form))


def test_what_is_cut_off_or_of_another_machine_is_told(tmp_path):
    whole = dataset(binary="<")
    with pytest.raises(RecordingError, match="truncated"):
        read(tmp_path, whole[:-500])
    with pytest.raises(RecordingError, match="truncated"):
        read(tmp_path, whole[: len(whole) // 2] + b"\n    -1\n")
    with pytest.raises(RecordingError, match="other than IEEE 754"):
        read(tmp_path, dataset(binary="<", form=1))
    text = dataset()
    with pytest.raises(RecordingError, match="truncated"):
        read(tmp_path, text[: len(text) // 2] + b"\n    -1\n")


def test_other_datasets_are_passed_over_in_silence(tmp_path, capfd):
    units = "    -1\n   164\n         1  SI: Meter (newton)         2\n    1.0E+00    1.0E+00    1.0E+00\n    2.7E+02\n    -1\n"
    other = "    -1\n  2467\n         1         0         0\nA\n    -1\n"
    assert list(read(tmp_path, units.encode(), other.encode(), dataset()).channels) == ["Mz"]
    with pytest.raises(RecordingError, match="has no dataset 58"):
        read(tmp_path, units.encode(), other.encode())
    assert capfd.readouterr() == ("", "")
