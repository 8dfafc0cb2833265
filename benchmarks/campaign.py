"""Cases per second of a campaign: scaling with workers and with cases, and what 1e6 cases on 1000
cores would take.

    python benchmarks/campaign.py [--cases 100,1000,10000] [--settle 2] [--record 4] [--workers 1,2]
    [--line-of-sight]

All figures of a table are measured in one run, alternating; what counts are their ratios. Overheads
are measured apart: until the first chunk is there, one chunk's way into its file, the merge per
case. The projection adds them up; it is arithmetic, not a run.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from microvib.model.sentences import validate_part
from microvib.studies.campaign.cases import BATCH_SIZE, Chunk, compute
from microvib.studies.campaign.design import design
from microvib.studies.campaign.folder import Campaign, create
from microvib.studies.campaign.results import merge
from microvib.studies.campaign.run import compute_missing
from microvib.studies.campaign.study_file import Study
from microvib.studies.workers import local

CHUNK = 256
"""Cases of a chunk in the projection."""


KEYS = ("reducer.stiffness", "motor.friction.viscous", "friction.breakaway", "motor.detent_torque")
EXAMPLE = str(Path(__file__).parents[1] / "examples" / "spacecraft.yaml")


def study(
    count: int, settle: float, record: float, scenario: str = "state-1", **changes: object
) -> Study:
    spread = {"distribution": "normal", "relative_deviation": "3 percent"}
    data = {
        "scenario": scenario,
        "set": {"record.settle": f"{settle} s", "record.duration": f"{record} s", **changes},
        "vary": dict.fromkeys(KEYS, spread),
        "sampling": {"method": "random", "count": count},
    }
    return validate_part(Study, data)


def timed(campaign: Campaign, workers: int) -> tuple[float, float]:
    """Seconds until the first chunk is there, and cases per second after it."""
    first: list[float] = []
    begun = time.perf_counter()

    def progress(done: int, total: int) -> None:
        if done and not first:
            first.extend((time.perf_counter() - begun, done))

    with local(workers) as backend:
        compute_missing(campaign, backend, progress=progress)
    seconds = time.perf_counter() - begun
    rest = campaign.design.cases - first[1]
    return first[0], rest / (seconds - first[0]) if rest else campaign.design.cases / seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", default="100,1000,10000")
    parser.add_argument("--workers", default=",".join(map(str, sorted({1, os.cpu_count() or 1}))))
    parser.add_argument("--settle", type=float, default=2.0)
    parser.add_argument("--record", type=float, default=4.0)
    parser.add_argument(
        "--line-of-sight",
        action="store_true",
        help="only: a craft's cases with its line of sight and without",
    )
    given = parser.parse_args()
    if given.line_of_sight:
        line_of_sight(given.settle, given.record)
        return
    sizes = [int(x) for x in given.cases.split(",")]
    workers = [int(x) for x in given.workers.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        per_case = alone(study(4 * BATCH_SIZE, given.settle, given.record), Path(folder) / "alone")
        rates, start, merging, written = scaling(
            Path(folder), sizes, workers, given.settle, given.record
        )
    print(f"\none core, no campaign: {1.0 / per_case:.3g} cases/s ({1e3 * per_case:.3g} ms a case)")
    few, many = min(workers), max(workers)
    for size in sizes:
        if few != many:
            ratio = statistics.median(rates[size, many]) / statistics.median(rates[size, few])
            print(f"{size} cases: {many} workers / {few}: {ratio:.2f}")
    project(per_case, start, merging, written)


def alone(of: Study, folder: Path) -> float:
    """Seconds of one case in one process, without workers and chunks' files."""
    drawn = design(of)
    campaign = create(drawn, folder, drawn.cases)
    compute(campaign.work(0, range(BATCH_SIZE)))  # compiled and warm
    begun = time.perf_counter()
    compute(campaign.work(0))
    return (time.perf_counter() - begun) / drawn.cases


def line_of_sight(settle: float, record: float) -> None:
    """Cases of a craft in one process, with its line of sight and with the torque alone,
    alternating.
    """
    studies = {
        "torque alone": study(
            2 * BATCH_SIZE, settle, record, EXAMPLE, **{"spacecraft.line_of_sight": None}
        ),
        "line of sight": study(2 * BATCH_SIZE, settle, record, EXAMPLE),
    }
    seconds: dict[str, list[float]] = {name: [] for name in studies}
    with tempfile.TemporaryDirectory() as folder:
        for again in range(3):
            for name, of in studies.items():
                seconds[name].append(alone(of, Path(folder) / f"{name} {again}"))
    for name, times in seconds.items():
        print(f"{name:14s} {1e3 * statistics.median(times):6.1f} ms a case")
    print(f"ratio {statistics.median(b / a for a, b in zip(*seconds.values(), strict=True)):.2f}")


def scaling(
    folder: Path, sizes: list[int], workers: list[int], settle: float, record: float
) -> tuple[dict[tuple[int, int], list[float]], float, float, float]:
    rates: dict[tuple[int, int], list[float]] = {}
    starts, written = [], 0.0
    print(f"{'cases':>8s} {'workers':>8s} {'first chunk s':>14s} {'cases/s':>9s}")
    for size in sizes:
        for again in range(3 if size <= 1000 else 1):
            for count in workers if again % 2 == 0 else workers[::-1]:
                campaign = create(
                    design(study(size, settle, record)), folder / f"{size}-{count}-{again}"
                )
                first, rate = timed(campaign, count)
                rates.setdefault((size, count), []).append(rate)
                starts.append(first)
                print(f"{size:8d} {count:8d} {first:14.2f} {rate:9.1f}", flush=True)
        data = campaign.file(0).read_bytes()
        begun = time.perf_counter()
        campaign.write(0, data)
        written = time.perf_counter() - begun
        print(f"{'':8s} chunk of {campaign.chunk_size}: {len(data) / 1e3:.0f} kB")
    merging = merged(folder / "merge", campaign.read(0), study(10 * CHUNK, settle, record))
    print(f"{'':8s} merge of chunks of {CHUNK}: {1e6 * merging:.0f} us a case")
    return rates, float(np.median(starts)), merging, written


def merged(folder: Path, of: Chunk, like: Study) -> float:
    """Seconds to merge one case out of chunks of the projection's size, filled with the results of
    a smaller one.
    """
    pick = np.arange(CHUNK) % len(of.reasons)
    chunk = replace(
        of,
        figures={name: values[pick] for name, values in of.figures.items()},
        status=of.status[pick],
        scalars={name: values[pick] for name, values in of.scalars.items()},
        verdict=of.verdict[pick],
        gaps=tuple(of.gaps[k] for k in pick),
        reasons=tuple(of.reasons[k] for k in pick),
        notes=tuple(of.notes[k] for k in pick),
    )
    campaign = create(design(like), folder, CHUNK)
    for k in range(campaign.chunks):
        campaign.write(k, replace(chunk, label=campaign.work(k).label).to_bytes())
    begun = time.perf_counter()
    merge(campaign)
    return (time.perf_counter() - begun) / campaign.design.cases


def project(per_case: float, start: float, merging: float, written: float) -> None:
    """1e6 cases on 1000 cores, as a Slurm array of 1000 shards with chunks of 256."""
    cases, cores, chunk = 10**6, 1000, CHUNK
    chunks = -(-cases // chunk)
    rounds = -(-chunks // cores)
    computing = rounds * (chunk * per_case + written)
    total = start + computing + merging * cases
    print(
        f"\n1e6 cases on 1000 cores: start {start:.1f} s + {rounds} chunks of {chunk} a core {computing:.0f} s + merge on one core"
        f" {merging * cases:.0f} s = {total / 60:.1f} min; parallel efficiency before the merge"
        f" {100 * cases * per_case / (cores * (start + computing)):.0f} %. Not counted: the scheduler's queue, the file system."
    )


if __name__ == "__main__":
    main()
