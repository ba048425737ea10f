# SPDX-License-Identifier: BSD-3-Clause
"""Files of finished jobs: whole or absent, and never those of another table."""

from pathlib import Path

import pytest
from short_walk import job_record, plan_of

from coclo_vio.experiments.table.job_store import JobStore
from coclo_vio.experiments.table.plan import TablePlan
from coclo_vio.runs.run_config import resolve
from coclo_vio.values import record
from coclo_vio.values.errors import DatasetError


@pytest.fixture
def store(tmp_path: Path) -> JobStore:
    made = JobStore(tmp_path)
    made.prepare()
    return made


def keep(store: JobStore, plan: TablePlan) -> None:
    for job in plan.jobs():
        figures: dict[str, dict[str, float | None]] = {name: {} for name in job.variant.trajectories}
        store.write(job, job_record(job.trial, job.seed, job.variant.name, figures, plan.fingerprint(job)))


def test_stored_jobs_are_found_again_by_a_longer_plan_too(store: JobStore) -> None:
    keep(store, plan_of(seeds=2))
    assert [job.name for job in store.kept(plan_of(seeds=3))] == ["flat_1_naive", "flat_2_naive"]
    assert sorted(path.name for path in (store.folder / "jobs").iterdir()) == ["flat_1_naive.json", "flat_2_naive.json"]


def test_jobs_made_with_other_settings_are_refused(store: JobStore) -> None:
    keep(store, plan_of(seeds=2))
    other = plan_of(seeds=4, config=resolve("daisy", settings=["filter.profile=paper"]))
    with pytest.raises(
        DatasetError, match=r"2 of the 2 finished jobs in .* \(configuration\); choose .*-o, or --fresh"
    ):
        store.kept(other)
    store.forget()
    assert store.kept(other) == {}


def test_a_damaged_file_is_a_job_that_is_not_finished(store: JobStore) -> None:
    plan = plan_of()
    keep(store, plan)
    path = store.folder / "jobs" / "flat_1_naive.json"
    path.write_text(path.read_text(encoding="utf-8")[:40], encoding="utf-8")
    assert store.kept(plan) == {}


def test_a_job_of_another_release_is_refused(store: JobStore) -> None:
    plan = plan_of()
    keep(store, plan)
    path = store.folder / "jobs" / "flat_1_naive.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"schema_version": 1,', "", 1), encoding="utf-8")
    with pytest.raises(DatasetError, match=r"flat_1_naive.json: it has no schema version.* --fresh"):
        store.kept(plan)


def test_a_full_disk_leaves_the_earlier_file(store: JobStore, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of()
    keep(store, plan)
    before = (store.folder / "jobs" / "flat_1_naive.json").read_bytes()

    def full(path: Path, _: object) -> None:
        path.write_text("{", encoding="utf-8")
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(record, "write_json", full)
    with pytest.raises(DatasetError, match="No space left on device"):
        keep(store, plan)
    assert [path.read_bytes() for path in (store.folder / "jobs").iterdir()] == [before]
