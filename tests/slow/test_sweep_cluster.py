"""Sweeps on Dask with a scheduler and workers in separate processes give the same rows as a single process."""

import os
import subprocess
import sys
import time

import pytest

import asrsim
from asrsim.engines import libraries
from asrsim.errors import SimulationError
from asrsim.sweeps import make_study
from asrsim.workers import cluster
from support.paths import ROOT

pytest.importorskip("pyarrow")
pytest.importorskip("distributed")

TWO_JOINTS = ROOT / "examples" / "scenarios" / "step_2dof.yaml"


def study_of(samples):
    return make_study(
        TWO_JOINTS,
        {"parameters.*.spring_a_1": "uniform(6, 10)"},
        samples=samples,
        variants=["soft"],
        overrides=["duration=0.05", "engine=mujoco"],
    )


class OtherVersions:
    """Function that returns wrong library versions in this process; a worker unpickles it as the original function."""

    def __call__(self):
        return {**libraries.numeric_versions(), "numpy": "1.0"}

    def __reduce__(self):
        return getattr, (libraries, "numeric_versions")


def start(*arguments):
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    command = [sys.executable, "-m", *arguments]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}, stdout=-3, stderr=-3)


def start_worker(address):
    return start("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")


@pytest.fixture
def scheduler(tmp_path):
    """Address and process of a Dask scheduler without workers."""
    import json

    file = tmp_path / "scheduler.json"
    arguments = ["--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    process = start("distributed.cli.dask_scheduler", "--host", "127.0.0.1", *arguments)
    try:
        end = time.monotonic() + 60
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"], process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def address(scheduler):
    """Address of a Dask scheduler without workers."""
    return scheduler[0]


@pytest.mark.slow
def test_dask_gives_the_same_rows_despite_killed_workers(address, tmp_path):
    """Killing the last worker also loses the study that was sent to the workers."""
    study = study_of(300)
    workers = [start_worker(address) for _ in range(2)]
    dead = []

    def kill(progress):
        if not dead:
            dead.append(workers.pop())
        elif progress.done >= 100 and len(dead) < 3:
            dead.extend(workers)
            workers.clear()
        for process in dead:
            process.kill()
        while len(workers) < 2:
            workers.append(start_worker(address))

    try:
        there = asrsim.sweep(study, out=tmp_path / "dask", cluster=address, progress=kill)
    finally:
        for process in (*workers, *dead):
            process.kill()
            process.wait()
    here = asrsim.sweep(study, out=tmp_path / "here", workers=1)
    assert len(dead) == 3
    assert there.to_arrow().drop_columns("seconds").equals(here.to_arrow().drop_columns("seconds"))


@pytest.mark.slow
def test_worker_with_other_library_versions_is_refused(address, tmp_path, monkeypatch):
    worker = start_worker(address)
    monkeypatch.setattr(cluster, "numeric_versions", OtherVersions())
    try:
        with pytest.raises(
            SimulationError, match=r"rows would differ between machines: worker .* has numpy .*, here it is 1\.0"
        ):
            asrsim.sweep(study_of(3), out=tmp_path / "s", cluster=address)
    finally:
        worker.kill()
        worker.wait()
    assert not list((tmp_path / "s").glob("*.parquet"))


@pytest.mark.slow
def test_missing_dask_workers_and_schedulers_are_reported_before_any_run(address, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 2.0)
    with pytest.raises(SimulationError, match="has no workers: start workers with: dask worker"):
        asrsim.sweep(study_of(3), out=tmp_path / "s", cluster=address)
    with pytest.raises(SimulationError, match="no scheduler answers at tcp"):
        asrsim.sweep(study_of(3), out=tmp_path / "s", cluster="tcp://127.0.0.1:9")
    assert not list((tmp_path / "s").glob("*.parquet"))


@pytest.mark.slow
def test_rows_are_kept_when_the_scheduler_disappears(scheduler, tmp_path):
    address, process = scheduler
    worker = start_worker(address)
    try:
        with pytest.raises(SimulationError, match="has stopped; rows received are kept"):
            asrsim.sweep(study_of(3000), out=tmp_path / "s", cluster=address, progress=lambda _: process.kill())
    finally:
        worker.kill()
        worker.wait()
    there = asrsim.sweep(study_of(3000), out=tmp_path / "s", resume=True, stop=lambda: True)
    assert 0 < len(there) < 3000
