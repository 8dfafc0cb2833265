"""Sound files (.wav) of data recorders: samples as parts of full scale, which the preparation gives
a size.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from microvib.io.measured import Column, Hints, recording_of
from microvib.testdata.channels import FULL_SCALE
from microvib.testdata.recording import Recording, RecordingError


def read_sound(path: Path, hints: Hints) -> Recording:
    """Channels ``channel 1``, ``channel 2`` and so on; full scale is 1, whatever the kind of
    numbers.
    """
    from scipy.io import wavfile

    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="Reached EOF prematurely")
        warnings.filterwarnings("ignore", message="Chunk")
        try:
            rate, data = wavfile.read(path)
        except wavfile.WavFileWarning:
            raise RecordingError("is truncated; it has fewer samples than it says") from None
    table = np.asarray(data).reshape(len(data), -1)
    if table.dtype == np.uint8:
        parts = (table.astype(float) - 128.0) / 128.0
    elif table.dtype.kind == "i":
        parts = table.astype(float) / 2.0 ** (8 * table.dtype.itemsize - 1)
    else:
        parts = table.astype(float)
    rates = {"its header": float(rate)}
    columns = [Column(f"channel {k + 1}", x, FULL_SCALE, rates) for k, x in enumerate(parts.T)]
    return recording_of(columns, hints, ["samples are parts of full scale"])
