"""The reference array's modes in CalculiX, where ``ccx`` is installed (Debian's ``calculix-ccx``)."""

import shutil

import numpy as np
import pytest
from support.calculix import in_calculix

from microvib.io.modal_sources import load_design
from microvib.structures.fem.described import solve_design

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed"),
]


def test_the_reference_array_in_calculix(tmp_path):
    design = load_design("reference-array")
    f, effective, total = in_calculix(design, tmp_path)
    modes = solve_design(design, 12)
    np.testing.assert_allclose(modes.frequency[:10], f[:10], rtol=0.01)
    torsion = int(np.argmax(effective))
    assert modes.participation[3, torsion] ** 2 == pytest.approx(effective[torsion], rel=0.01)
