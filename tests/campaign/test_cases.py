"""Cases are computed the same by whoever computes them; one that fails, hangs or kills its worker costs one case."""

from __future__ import annotations

import os
import socket
import threading
from concurrent.futures import Future
from contextlib import suppress

import h5py
import numpy as np
import psutil
import pytest
from support.campaigns import (
    EVERYTHING,
    SHORT,
    Fragile,
    Inline,
    bytes_of,
    computed,
    made,
    spread,
    study,
)
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.errors import MicrovibError
from microvib.reports.campaign.report import campaign_outcome, summarise
from microvib.reports.outcome import terminal_text
from microvib.studies.campaign import cases as computing
from microvib.studies.campaign.folder import Campaign
from microvib.studies.campaign.results import DONE, FAILED, merge, open_results
from microvib.studies.campaign.run import MAX_WORKER_DEATHS, compute_missing
from microvib.studies.campaign.statistics import largest_line
from microvib.studies.workers import local


def figures_of(campaign: Campaign) -> dict[str, np.ndarray]:
    merge(campaign)
    with h5py.File(campaign.folder / "results.nc") as f:
        return {
            name: f[name][...]
            for name in ("amplitude", "frequency", "phase", "state", "peak", "rms")
        }


def same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(a[name], b[name], equal_nan=True) for name in a)


def test_results_do_not_depend_on_chunks_workers_or_order(tmp_path):
    one, two, three = (made(tmp_path, spread(), f"c{k}", size) for k, size in enumerate((12, 5, 5)))
    compute_missing(one, Fragile())
    with local(2) as backend:
        compute_missing(two, backend)
    for k in (1, 0):  # shards, the last first
        compute_missing(three, Fragile(), shard=(k, 2))
    assert bytes_of(two) == bytes_of(three)
    assert same(figures_of(one), figures_of(two))
    assert np.all(figures_of(one)["state"] == DONE)


def test_dask_gives_the_same_bytes(tmp_path):
    from microvib.studies.campaign.on_dask import dask

    one, two = (made(tmp_path, spread(), name, 3) for name in ("inline", "dask"))
    compute_missing(one, Fragile())
    with dask(2) as backend:
        compute_missing(two, backend)
    assert bytes_of(one) == bytes_of(two)


TURNED_AWAY = "Timed out|closed|Connection reset|certificate does not match"


def listening(process: psutil.Process) -> list[tuple[str, int]]:
    """Addresses at which a process and its children take connections."""
    family = [process, *process.children(recursive=True)]
    found = [
        c for one in family for c in one.net_connections("inet") if c.status == psutil.CONN_LISTEN
    ]
    return [(c.laddr.ip, c.laddr.port) for c in found]


def test_nobody_else_can_use_the_cluster():
    """Each of its sockets is of TLS, which turns away a client with no certificate, and one with another of the same kind."""
    from distributed import Client, Security

    from microvib.studies.campaign.on_dask import dask

    before = set(listening(psutil.Process()))
    with dask(1) as backend:
        opened = sorted(set(listening(psutil.Process())) - before)
        assert len(opened) == 3  # scheduler, worker and its nanny: none serves HTTP
        assert {address for address, _ in opened} == {"127.0.0.1"}
        for address, port in opened:
            with (
                pytest.raises(OSError, match=TURNED_AWAY),
                Client(f"tcp://{address}:{port}", timeout="2s"),
            ):
                pass
            with (
                pytest.raises(OSError, match=TURNED_AWAY),
                Client(f"tls://{address}:{port}", timeout="2s", security=Security.temporary()),
            ):
                pass
            with socket.create_connection((address, port), timeout=5) as client:
                client.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
                with suppress(ConnectionResetError):
                    assert b"HTTP" not in client.recv(1000)
        assert backend.executor().submit(os.getpid).result(30) in [
            p.pid for p in psutil.Process().children(True)
        ]


def test_no_scheduler_is_a_sentence(monkeypatch):
    from microvib.studies.campaign import on_dask

    monkeypatch.setattr(on_dask, "CONNECT_TIMEOUT", "1s")
    with (
        pytest.raises(MicrovibError, match="no Dask scheduler answers there"),
        on_dask.dask(1, "tcp://127.0.0.1:9"),
    ):
        pass


def test_a_case_agrees_with_the_run_of_its_scenario(tmp_path):
    campaign = made(tmp_path, spread(count=1))
    compute_missing(campaign, Fragile())
    chunk = campaign.read(0)
    table = mv.find_lines(mv.simulate(campaign.design.scenario(1)))
    for name in ("drive_1", "drive_2"):
        k = chunk.lines.index(name)
        assert chunk.figures["amplitude"][1, k] == pytest.approx(table[name].amplitude, rel=2e-3)


def test_a_campaign_judges_what_a_run_judges(tmp_path):
    """Also lines that nobody expected, and what could not be looked at. Stick and slip in turns make the former at this rate."""
    vary = {"driver.microsteps": [16, 32], "record.sample_rate": ["100 Hz", "1024 Hz"]}
    record = {"record.settle": "6 s", "record.duration": "6 s", "tracking.rate": "0.02 deg/s"}
    campaign = made(
        tmp_path, study(vary=vary, set=record, limit="40 mN*m", band="1.5:400 Hz", harmonics=8)
    )
    compute_missing(campaign, Fragile())
    merge(campaign)
    results = open_results(campaign)
    seen = set()
    for case in range(4):
        scenario = campaign.design.scenario(case)
        table = mv.find_lines(mv.simulate(scenario))
        expected = judge(table, limit_of(0.04, 1.5, 400.0), scenario)
        assert computing.VERDICTS[results.verdicts[case]] == expected.verdict
        assert bool(results.gaps[case]) == bool(expected.gaps)
        finite = [x.amplitude for x in table if np.isfinite(x.amplitude)]
        assert largest_line(results, EVERYTHING)[case] == pytest.approx(max(finite), rel=5e-3)
        seen.add(expected.verdict)
    assert "not judged" in seen
    assert any(name.startswith("other_") for name in results.lines)


def test_steady_cases(tmp_path):
    campaign = made(tmp_path, study(solve="steady", vary={"driver.microsteps": [16]}, harmonics=8))
    compute_missing(campaign, Fragile())
    chunk = campaign.read(0)
    lines = mv.find_lines(campaign.design.scenario(0), start="steady")
    assert chunk.figures["amplitude"][0, chunk.lines.index("drive_1")] == lines["drive_1"].amplitude


def test_cases_without_a_steady_state_are_counted_with_their_reasons(tmp_path):
    """Of two cases one has friction that varies with the angle."""
    position = {"harmonics": [{"order": 1, "amplitude": 0.0}]}
    vary = {"friction.position.harmonics.0.amplitude": [0.0, 0.05]}
    results = computed(
        tmp_path, study(solve="steady", vary=vary, set={**SHORT, "friction.position": position})
    )
    text = terminal_text(campaign_outcome(summarise(results, None, EVERYTHING)))
    assert (
        "1 of 2 cases have no steady state and were integrated from rest instead: 1 x friction that varies"
        in text
    )
    alone = computed(tmp_path / "alone", study(solve="steady"))
    assert "no steady state" not in terminal_text(
        campaign_outcome(summarise(alone, None, EVERYTHING))
    )


def test_histories_are_kept_when_asked_for(tmp_path):
    campaign = made(tmp_path, study(keep=["T_d"]))
    compute_missing(campaign, Fragile())
    kept = campaign.read(0).histories
    motion = mv.simulate(campaign.design.scenario(1), channels=("T_d",))
    assert sorted(kept) == [0, 1]
    assert np.abs(kept[1] - motion["T_d"]).max() < 1e-2 * np.abs(motion["T_d"]).max()


def test_statuses_of_many_cases_are_few(tmp_path):
    """Each rate needs a record of its own length; two hundred of such texts would be no status."""
    rates = {"from": "0.001 deg/s", "to": "0.06 deg/s", "count": 40}
    campaign = made(tmp_path, study(vary={"tracking.rate": rates}))
    compute_missing(campaign, Fragile())
    statuses = {text for _, chunk in campaign.results() for text in chunk.statuses}
    assert "not resolved" in statuses
    assert len(statuses) < 40
    assert not any(c.isdigit() for text in statuses for c in text.partition(" from ")[0])


def test_failures_keep_their_reason_and_stop_nothing(tmp_path, monkeypatch):
    rates = ["0.06 deg/s", "50 deg/s", "0.07 deg/s"]  # the motor cannot follow the second
    spread = {
        "distribution": "normal",
        "mean": "6 ohm",
        "deviation": "6 ohm",
    }  # negative now and then
    monkeypatch.setattr("microvib.studies.campaign.design.TRIAL_QUANTILES", (0.5,))
    campaign = made(tmp_path, study(vary={"tracking.rate": rates, "motor.winding_resistance": spread},
                                    sampling={"method": "random", "count": 8}))  # fmt: skip
    real = computing.find_lines
    broken = campaign.design.scenario(0).motor.winding_resistance

    def sometimes(torque, harmonics):
        scenario = torque.scenario
        if scenario.motor.winding_resistance == broken and scenario.tracking.rate < np.radians(
            0.065
        ):
            raise ZeroDivisionError("deliberate")
        return real(torque, harmonics=harmonics)

    monkeypatch.setattr(computing, "find_lines", sometimes)
    compute_missing(campaign, Fragile())
    merge(campaign)
    results = open_results(campaign)
    reasons = results.reasons
    assert reasons[0] == "unexpected ZeroDivisionError: deliberate"
    assert all(
        "loss of synchronism" in r or "must be greater than 0 ohm" in r for r in reasons[8:16]
    )
    negative = [
        k for k in range(24) if campaign.design.changes(k)["motor.winding_resistance"] <= 0.0
    ]
    assert negative
    assert all("motor.winding_resistance" in reasons[k] for k in negative)
    fine = [k for k in (*range(1, 8), *range(16, 24)) if k not in negative]
    assert all(results.state[k] == DONE for k in fine)
    assert np.sum(results.state == FAILED) == 24 - len(fine)


def test_a_deadly_case_is_found_and_the_others_are_computed(tmp_path):
    levels = {"vary": {"driver.microsteps": [4, 8, 16, 32]}}
    hurt, whole = (
        made(tmp_path, study(**levels), "hurt", 2),
        made(tmp_path, study(**levels), "whole", 2),
    )
    compute_missing(hurt, Fragile(crashing=(16,)))
    compute_missing(whole, Fragile())
    merge(hurt)
    results = open_results(hurt)
    assert "its worker died each time" in results.reasons[2]
    assert list(results.state) == [DONE, DONE, FAILED, DONE]
    assert bytes_of(hurt)[0] == bytes_of(whole)[0]
    assert MAX_WORKER_DEATHS > 1


def test_workers_that_cannot_start_are_no_fault_of_the_cases(tmp_path):
    class Dead(Fragile):
        def executor(self):
            executor = Inline()
            executor.submit = lambda fn, work: (
                future := Future(),
                future.set_exception(BrokenPipeError()),
            )[0]
            return executor

    campaign = made(tmp_path, study())
    with pytest.raises(MicrovibError, match="workers end as soon as they start"):
        compute_missing(campaign, Dead())
    assert campaign.done() == []


def test_a_case_that_wants_too_much_memory_costs_one_case(tmp_path, monkeypatch):
    real = computing.simulate_torques

    def simulate(scenarios, **keys):
        if any(scenario.driver.microsteps == 16 for scenario in scenarios):
            raise MemoryError
        return real(scenarios, **keys)

    levels = {"vary": {"driver.microsteps": [4, 8, 16, 32]}}
    whole, short = (
        made(tmp_path, study(**levels), "whole"),
        made(tmp_path, study(**levels), "short"),
    )
    compute_missing(whole, Fragile())
    monkeypatch.setattr(computing, "simulate_torques", simulate)
    compute_missing(short, Fragile())
    merge(short)
    results = open_results(short)
    assert list(results.state) == [DONE, DONE, FAILED, DONE]
    assert "out of memory" in results.reasons[2]
    np.testing.assert_array_equal(
        short.read(0).figures["amplitude"][3], whole.read(0).figures["amplitude"][3]
    )


def test_cases_that_take_longer_than_they_may_end_their_worker(tmp_path, monkeypatch):
    ended = threading.Event()
    monkeypatch.setattr(computing, "_kill_process", ended.set)
    monkeypatch.setattr(computing, "STARTUP_ALLOWANCE", 0.0)
    real = computing.simulate_torques

    def slow(scenarios, **keys):
        ended.wait(5.0)
        return real(scenarios, **keys)

    monkeypatch.setattr(computing, "simulate_torques", slow)
    computing.compute_bytes(made(tmp_path, study(time_limit="0.05 s")).work(0))
    assert ended.is_set()
    ended.clear()
    monkeypatch.setattr(computing, "simulate_torques", real)
    computing.compute_bytes(made(tmp_path, study(time_limit="10 min"), "patient").work(0))
    assert not ended.wait(0.2)
