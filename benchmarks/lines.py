"""How often the stated uncertainties of lines cover the truth: array modes near each other and near
a line of the clock.

    python benchmarks/lines.py             # coverage over distance, noise and decay
    python benchmarks/lines.py --records 400

Records are made: tones whose frequencies, decays and amplitudes are known, in Gaussian noise.
Claimed are the lines whose status gives a figure; the others are not separable or not found. Of the
claims, those are counted whose amplitude and frequency are within two standard uncertainties of the
truth.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.coverage import coverage

DISTANCES = (2.6, 3.0, 4.0, 6.0, 9.0)
NOISES = (0.001, 0.2, 2.0)
FOLDS = (0.3, 1.0, 3.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument(
        "--searched", action="store_true", help="the clock is searched, as in a recording"
    )
    arguments = parser.parse_args()
    print(
        f"{'pair':6s} {'bins':>5s} {'noise':>6s} {'folds':>6s} {'amplitude %':>12s} {'frequency %':>12s} {'claimed %':>10s}"
    )
    for pair in ("modes", "clock"):
        for distance in DISTANCES:
            for noise in NOISES:
                for fold in FOLDS:
                    c = coverage(pair, distance, noise, fold, arguments.records, arguments.searched)
                    figures = f"{100 * c.amplitude:12.1f} {100 * c.frequency:12.1f} {100 * c.claimed:10.1f}"
                    print(
                        f"{pair:6s} {distance:5.1f} {noise:6.3f} {fold:6.1f} {figures}", flush=True
                    )


if __name__ == "__main__":
    main()
