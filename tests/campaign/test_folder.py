"""A campaign's folder: what is damaged, edited, of another campaign or of another version is refused; what is lost is made again."""

from __future__ import annotations

import os
import resource
import shutil
import signal

import h5py
import numpy as np
import pytest
from support.campaigns import Fragile, bytes_of, made, spread

from microvib.errors import MicrovibError, OutputError
from microvib.reports.campaign.text import state_text
from microvib.studies.campaign import cases as computing
from microvib.studies.campaign import folder
from microvib.studies.campaign.folder import open_campaign
from microvib.studies.campaign.results import merge, open_results
from microvib.studies.campaign.run import compute_missing


def test_an_opened_campaign_is_the_one_that_was_made(tmp_path):
    campaign = made(tmp_path, spread())
    again = open_campaign(campaign.folder)
    assert again.identity == campaign.identity
    assert [again.design.changes(k) for k in range(12)] == [
        campaign.design.changes(k) for k in range(12)
    ]
    assert [x.text for x in again.design.uncertain] == [x.text for x in campaign.design.uncertain]


def test_a_full_disk_leaves_nothing_and_loses_nothing(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile(), shard=(0, 2))
    before = bytes_of(campaign)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OutputError, match="what was computed before is kept"):
            compute_missing(campaign, Fragile())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert bytes_of(campaign) == before
    assert all(not name.startswith(".") for name in os.listdir(campaign.folder / "chunks"))
    compute_missing(campaign, Fragile())
    assert campaign.missing() == []


def test_a_damaged_chunk_is_a_sentence_and_is_computed_again(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile())
    good = campaign.file(1).read_bytes()
    campaign.file(1).write_bytes(good[:-100])
    with pytest.raises(MicrovibError, match="is damaged"):
        merge(campaign)
    campaign.file(1).unlink()
    compute_missing(campaign, Fragile())
    assert campaign.file(1).read_bytes() == good


def test_a_chunk_whose_figures_were_edited_is_a_sentence(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile())
    with np.load(campaign.file(1)) as file:
        named = dict(file)
    named["figure_amplitude"] = 0.1 * named["figure_amplitude"]
    with campaign.file(1).open("wb") as stream:
        np.savez(stream, **named)
    with pytest.raises(MicrovibError, match="its figures were changed since it was computed"):
        merge(campaign)
    del named["sha256"]  # as an older version wrote it
    with campaign.file(1).open("wb") as stream:
        np.savez(stream, **named)
    assert merge(campaign).done == 12


def test_merged_results_that_were_edited_are_refused(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile())
    path = merge(campaign).path
    assert open_results(campaign).path == path
    with h5py.File(path, "r+") as file:
        file["amplitude"][...] = 0.0
    with pytest.raises(MicrovibError, match=r"results.nc: was changed since it was merged; merge"):
        open_results(campaign)
    merge(campaign)
    assert open_results(campaign).path == path


def test_a_campaign_that_was_changed_is_refused(tmp_path):
    campaign = made(tmp_path, spread())
    samples = np.load(campaign.folder / "samples.npy")
    np.save(campaign.folder / "samples.npy", samples * 1.01)
    with pytest.raises(MicrovibError, match="were changed after the campaign was made"):
        open_campaign(campaign.folder)


def test_a_chunk_in_the_wrong_place_is_refused_wherever_it_is_read(tmp_path):
    one, other = (
        made(tmp_path, spread(), "one", 3),
        made(tmp_path, spread(limit="50 mN*m"), "other", 3),
    )
    for campaign in (one, other):
        compute_missing(campaign, Fragile())
    first, second = one.file(0), one.file(1)
    kept = first.read_bytes()
    first.write_bytes(second.read_bytes())
    for look in (merge, state_text):
        with pytest.raises(MicrovibError, match="is chunk 1 of this campaign"):
            look(one)
    first.write_bytes(
        other.file(0).read_bytes()
    )  # the same figures, but of a study with another limit
    with pytest.raises(MicrovibError, match="is of another campaign"):
        merge(one)
    first.write_bytes(kept)
    assert merge(one).done == 12


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("study.yaml", "60 mN*m", "90 mN*m"),
        ("study.yaml", "count: 6", "count: 60"),
        ("scenario.yaml", "ratio: 100", "ratio: 101"),
        ("campaign.json", '"microvib": "', '"microvib": "9.'),
        ("campaign.json", '"chunk_size": 3', '"chunk_size": 4'),
        ("campaign.json", '"chunk_size": 3', '"chunk_size": 0'),
    ],
)
def test_no_file_of_a_campaign_may_be_edited(tmp_path, name, old, new):
    campaign = made(tmp_path, spread(limit="60 mN*m"), chunk=3)
    file = campaign.folder / name
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(
        MicrovibError, match=r"were changed after the campaign was made|is not a whole campaign"
    ):
        open_campaign(campaign.folder)


def test_another_version_does_not_go_on(tmp_path, monkeypatch):
    campaign = made(tmp_path, spread(), chunk=3)
    for module in (folder, computing):
        monkeypatch.setattr(module, "package_versions", lambda: {"microvib": "9.0"})
    with pytest.raises(MicrovibError, match=r"was made by microvib .*, and this is 9\.0"):
        compute_missing(campaign, Fragile())
    with pytest.raises(
        MicrovibError, match=r"this is microvib 9\.0, but the campaign was made by"
    ):  # as on a worker
        computing.compute(campaign.work(0))


def test_a_lost_manifest_is_made_again_from_any_chunk(tmp_path):
    campaign = made(tmp_path, spread(), chunk=3)
    compute_missing(campaign, Fragile(), shard=(1, 2))
    text = (campaign.folder / "campaign.json").read_text()
    (campaign.folder / "campaign.json").unlink()
    again = open_campaign(campaign.folder)
    assert "was written again" in again.repair_note
    assert (campaign.folder / "campaign.json").read_text() == text
    compute_missing(again, Fragile())
    assert merge(again).done == 12
    (campaign.folder / "campaign.json").unlink()
    shutil.rmtree(campaign.folder / "chunks")
    with pytest.raises(MicrovibError, match="is not a campaign"):
        open_campaign(campaign.folder)
