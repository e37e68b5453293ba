"""Sweeps: points of a study, rows that do not depend on who did them, workers that die, resumption, pictures."""

import json
import os
import random
import re

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError, OutputError
from asrsim.simulation.prepare import prepare
from asrsim.sweeps import Table, make_study
from asrsim.sweeps.cases import make_payload
from asrsim.sweeps.pictures import over_key
from asrsim.sweeps.rows import Runner, alone
from asrsim.sweeps.run import crashed_row, run_again
from asrsim.sweeps.sensitivity import influences, sobol
from asrsim.sweeps.show import remarks, result_rows, study_data, varying
from asrsim.sweeps.store import Store, open_store
from asrsim.workers import Lost
from support.edits import edits
from support.paths import ROOT
from support.tiny import PENDULUM

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

EXAMPLES = ROOT / "examples" / "scenarios"
TWO_JOINTS = EXAMPLES / "step_2dof.yaml"
SHORT = ["duration=0.05", "engine=mujoco", "compiled=false"]


def study_of(over, scenario=TWO_JOINTS, **options):
    options = {"variants": ["soft"] if scenario == TWO_JOINTS else [], "overrides": SHORT, **options}
    return make_study(scenario, over, **options)


def cells_of(payload, row):
    return dict(zip(payload.kinds, row, strict=True))


# -- points -------------------------------------------------------------------------------------------------------------


def test_a_grid_has_every_combination_once():
    study = study_of({"a.x": "log:1:100:3", "a.y": [5, 6], "a.z & a.w": [[1, 2], [3, 4]]})
    points = [tuple(study.point(run)[1].values()) for run in range(len(study))]
    assert len(study) == len(points) == 12
    assert set(points) == {(x, y, *zw) for x in (1.0, 10.0, 100.0) for y in (5, 6) for zw in ((1, 2), (3, 4))}
    assert [study_of({"a": [[1], [2, 3]]}).point(run)[1] for run in (0, 1)] == [{"a": [1]}, {"a": [2, 3]}]


@pytest.mark.parametrize("sampler", ["random", "lhs", "sobol"])
@pytest.mark.parametrize(
    ("law", "mean", "deviation"),
    [
        ("uniform(2, 4)", 3.0, 2 / 12**0.5),
        ("normal(5, 0.5)", 5.0, 0.5),
        ("lognormal(2, 0.3)", 2 * np.exp(0.045), 2 * np.exp(0.045) * (np.exp(0.09) - 1) ** 0.5),
        ("loguniform(1, 10)", 9 / np.log(10), (99 / (2 * np.log(10)) - (9 / np.log(10)) ** 2) ** 0.5),
    ],
)
def test_draws_have_their_distribution(sampler, law, mean, deviation):
    values = study_of({"a.x": law, "a.y": "uniform(0, 1)"}, samples=4096, sampler=sampler).table[:, 0]
    assert values.mean() == pytest.approx(mean, abs=4 * deviation / 64)
    assert values.std() == pytest.approx(deviation, rel=0.06)


def test_draws_follow_their_seed():
    over = {"a.x": "normal(0, 1)", "a.y": "lognormal(1, 0.5)"}
    tables = [study_of(over, samples=40, seed=seed).table for seed in (3, 3, 4)]
    assert np.array_equal(tables[0], tables[1])
    assert not np.array_equal(tables[0], tables[2])


def test_a_logarithmic_fit_draws_positive_values_and_warns_of_gaps():
    told = [{"key": "a.x", "verdict": "weak"}, {"key": "a.z", "verdict": "only as ratio"}]
    fit = {"keys": ["a.x", "a.y"], "mean": [np.log(2.0), 3.0], "covariance": [[0.25, 0.1], [0.1, 0.09]], "estimates": told}
    study = study_of({}, samples=20_000, fit={**fit, "logarithmic": [True, False]})
    drawn = np.column_stack([np.log(study.table[:, 0]), study.table[:, 1]])
    np.testing.assert_allclose(np.cov(drawn.T), fit["covariance"], atol=0.01)
    np.testing.assert_allclose(drawn.mean(axis=0), fit["mean"], atol=0.02)
    assert [warning.split(": ")[0] for warning in study.joint.warnings] == [
        "the fit has no distribution of a.z (only as ratio)"
    ]
    one = {"covariance": [[0.25, 0.0], [0.0, 0.0]], "estimates": [{"key": "a.y", "verdict": "weak"}], "fits": False}
    sure = study_of({}, samples=20, fit={**fit, **one})
    assert ["does not fit" in text for text in sure.joint.warnings] == [True, False]
    assert "no interval of a.y (weak)" in sure.joint.warnings[1]
    assert np.ptp(sure.table[:, 1]) == 0.0 < np.ptp(sure.table[:, 0])
    with pytest.raises(InputError, match="logarithmic"):
        study_of({}, samples=20, fit={**fit, "logarithmic": [True]})


def test_tied_keys_follow_bounded_draws_of_a_fit():
    """As in the fit itself: else springs of one pair would differ, and friction be negative in runs that fail."""
    ties = [
        {"key": "a.y", "to": "a.x", "factor": 2},
        {"key": "a.w", "to": "a.y", "factor": 3},
        {"key": "b.y", "to": "b.x", "factor": 1},
    ]
    fit = {"keys": ["a.x", "a.z"], "mean": [1.0, 0.1], "covariance": [[1e-4, 0], [0, 1]], "ties": ties}
    study = study_of({"c.x": "uniform(0, 1)"}, samples=50, fit={**fit, "bounds": [[None, None], [0, 0.5]]})
    points = [study.point(run)[1] for run in range(50)]
    assert tuple(points[0]) == study.keys == ("c.x", "a.x", "a.y", "a.w", "a.z")
    assert study.groups == (("c.x",), ("a.x", "a.y", "a.w"), ("a.z",))
    assert all(one["a.y"] == 2 * one["a.x"] and one["a.w"] == 6 * one["a.x"] for one in points)
    drawn = [one["a.z"] for one in points]
    assert (min(drawn), max(drawn)) == (0, 0.5)
    assert len(set(drawn)) > 10
    for wrong in ({"bounds": [[0, 1]]}, {"bounds": [[1, 0], [0, 1]]}, {"bounds": "x"}, {"ties": ["a.x = a.y"]}):
        with pytest.raises(InputError, match=r"bounds|ties"):
            study_of({}, samples=5, fit={**fit, **wrong})


@pytest.mark.parametrize(
    ("over", "options", "word"),
    [
        ({"a": "1:2"}, {}, "Valid forms"),
        ({"a": "uniform(0,)"}, {"samples": 5}, "^a: must be a finite number"),
        ({"a": "normal(1, 0)"}, {}, "above 0"),
        ({"a": "log:0:1:3"}, {}, "above 0"),
        ({"a": "gauss(1, 2)"}, {}, "no distribution 'gauss'"),
        ({}, {}, "no key is varied"),
        ({"a": "1:2:3", "b & a": [1]}, {}, "varied twice"),
        ({"a": "1:2:3"}, {"samples": 5}, "no key has a distribution"),
        ({"a": "normal(1,1)"}, {"sampler": "magic"}, "magic"),
        ({"a": "normal(1,1)", "b": [1, 2]}, {"sampler": "saltelli"}, "neither a fit nor listed values"),
        ({}, {"fit": {"keys": ["a"], "mean": [1], "covariance": [[-1]]}}, "not a covariance"),
    ],
)
def test_what_no_study_is(over, options, word):
    with pytest.raises(InputError, match=word):
        make_study(TWO_JOINTS, over, **options)


@pytest.mark.parametrize(
    ("key", "word"),
    [
        ("link_1.mas", "Did you mean 'mass'"),
        ("lnk_1.mass", "link_1"),
        ("parameters.*.nonsense", "no such parameter"),
        ("references.*.stiffness_preset", "changes nothing"),
        ("duratoin", "duration"),
    ],
)
def test_unknown_keys_are_reported_before_any_run(key, word):
    with pytest.raises(InputError, match=word):
        make_payload(study_of({key: [1.0, 2.0]}))


# -- rows ---------------------------------------------------------------------------------------------------------------

ARM = {
    "parameters.*.spring_a_1": "uniform(6, 10)",
    "references.joint_1.stiffness_preset": "uniform(0.2, 0.6)",
    "link_1.mass": "uniform(0.3, 0.5)",
    "joint_2.damping": "uniform(0, 0.01)",
    "joint_1.friction": "uniform(0, 0.1)",
}
ROBOTS = {
    "step_2dof": (TWO_JOINTS, ARM),
    "awas": (EXAMPLES / "step_1dof_awas_ii.yaml", {"parameters.*.motor_1_inertia": "lognormal(0.001, 0.3)"}),
}


def fresh_row(payload, run):
    """Cells of a run that is prepared for itself."""
    variant, values = payload.study.point(run)
    return alone(payload.cases[variant], values)


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
@pytest.mark.parametrize("compiled", ["false", pytest.param("true", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", list(ROBOTS))
def test_other_numbers_give_the_bits_of_a_fresh_start(name, engine, compiled):
    if engine == "bullet":
        pytest.importorskip("pybullet")
    scenario, over = ROBOTS[name]
    study = study_of(over, scenario, samples=6, overrides=[f"engine={engine}", "duration=0.1", f"compiled={compiled}"])
    payload = make_payload(study)
    runner = Runner(payload)
    runs = (3, 1, 4, 3)
    for run, found in zip((*runs, 2), [*runner.several(runs), runner(2)], strict=True):
        row, fresh = cells_of(payload, found), fresh_row(payload, run)
        assert {key: row[key] for key in fresh} == fresh
        assert row["status"] == "complete"
    runner.close()


def test_one_worker_two_and_resumption_give_equal_rows(tmp_path):
    study = study_of(
        {"parameters.*.spring_a_1": "uniform(6, 10)", "duration": [0.05, 0.06]},
        samples=4,
        overrides=["engine=mujoco", "compiled=false"],
    )
    two = asrsim.sweep(study, out=tmp_path / "two", workers=2).to_arrow().drop_columns("seconds")
    seen = []
    stopped = {"progress": seen.append, "stop": lambda: bool(seen) and seen[-1].done >= 3}
    assert 0 < len(asrsim.sweep(study, out=tmp_path / "one", workers=1, **stopped)) < 8
    assert asrsim.sweep(study, out=tmp_path / "one", workers=1, resume=True).to_arrow().drop_columns("seconds").equals(two)
    # No scheduler listens at this address, and a complete study needs none.
    assert asrsim.sweep(study, out=tmp_path / "one", cluster="tcp://127.0.0.1:1", resume=True).missing == 0


def test_a_run_repeated_alone_has_the_numbers_of_its_row(tmp_path):
    over = {"link_1.mass": [0.3, 0.5], "references.joint_1.stiffness_preset": [0.2, 0.4]}
    table = asrsim.sweep(study_of(over, overrides=[*SHORT, "duration=0.2"]), out=tmp_path / "s", workers=1)
    peaks = table["joint_1.peak_deflection"]
    assert len(set(peaks)) == 4
    for run in (1, 2):
        assert run_again(table, run, tmp_path / f"{run}").joint("joint_1").measures.peak_deflection == peaks[run]


def test_a_study_where_nothing_can_run_says_so_at_once(tmp_path):
    with pytest.raises(InputError, match=r"got -2\.0"):
        asrsim.sweep(study_of({"parameters.*.spring_a_1": [-2.0, -1.0]}), out=tmp_path / "s", workers=1)


def test_varied_keys_and_measures_have_their_units():
    units = {"gravity.2": "m/s^2", "base.position.0": "m", "initial.joint_1": "rad", "duration": "s", "seed": "",
             "link_1.mass": "kg", "joint_1.damping": "N m s/rad", "parameters.*.motor_1_inertia": "kg m^2"}  # fmt: skip
    columns = make_payload(study_of({name: [0.01] for name in units} | {"seed": [3]})).columns
    units |= {"joint_1.steady_state": "rad", "joint_1.settling": "s", "joint_1.frequency": "Hz", "joint_1.overshoot": ""}
    assert {name: unit for name, _, unit in columns if name in units} == units


# -- faults -------------------------------------------------------------------------------------------------------------


def test_a_run_that_kills_its_workers_becomes_a_row():
    payload = make_payload(study_of({"parameters.*.spring_a_1": [6.0, 7.0, 8.0]}))
    row = cells_of(payload, crashed_row(payload, 2, Lost("3 workers died in this run")))
    assert (row["run"], row["status"], row["reason"]) == (2, "crashed", "3 workers died in this run")
    assert row["parameters.*.spring_a_1"] == 8.0


def test_folders_of_others_and_of_other_studies_are_refused(tmp_path):
    study = study_of({"link_1.mass": [0.3, 0.4]})
    asrsim.sweep(study, out=tmp_path / "s", workers=1)
    with pytest.raises(InputError, match="contains rows"):
        asrsim.sweep(study, out=tmp_path / "s", workers=1)
    with pytest.raises(InputError, match="contains no study") as caught:
        Table(tmp_path)
    assert caught.value.problems[0].file == tmp_path
    with pytest.raises(InputError, match="other values of over"):
        asrsim.sweep(study_of({"link_1.mass": [0.3, 0.5]}), out=tmp_path / "s", workers=1, resume=True)
    other = study_of({"link_1.mass": [0.3, 0.5, 0.6]})
    assert asrsim.sweep(other, out=tmp_path / "s", workers=1, overwrite=True, stop=lambda: True).missing == 3


def test_a_study_is_not_resumed_after_an_input_changed(tmp_path):
    """Inputs: robot, meshes, files of signals, plugins."""
    mesh = '<collision><geometry><mesh filename="part.obj"/></geometry></collision></link>'
    (tmp_path / "arm.urdf").write_text(PENDULUM.replace("</link>", mesh))
    (tmp_path / "part.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    (tmp_path / "push.csv").write_text("time [s],torque [N m]\n0,0.1\n2,0.1\n")
    (tmp_path / "law.py").write_text((ROOT / "examples" / "plugins" / "my_vsa.py").read_text())
    push = "external_torques: {elbow: {playback: {file: push.csv, column: torque}}}"
    scenario = tmp_path / "s.yaml"
    scenario.write_text(f"robot: arm.urdf\nduration: 0.01\n{push}\n")
    study = make_study(scenario, {"arm.mass": [0.3, 0.4]}, plugins=[tmp_path / "law.py"])
    asrsim.sweep(study, out=tmp_path / "out", workers=1)
    asrsim.sweep(study, out=tmp_path / "out", workers=1, resume=True)
    for changed in ("arm.urdf", "part.obj", "push.csv", "law.py"):
        text = (tmp_path / changed).read_text()
        (tmp_path / changed).write_text(text + "# 1\n" if changed == "law.py" else text.replace("0.1", "0.11"))
        with pytest.raises(InputError, match=rf"inputs have changed: {changed}\. Start again"):
            asrsim.sweep(study, out=tmp_path / "out", workers=1, resume=True)
        (tmp_path / changed).write_text(text)


def test_a_refusal_names_all_that_changed(tmp_path):
    """Here the samples of the study and the recording that a claim compares with."""
    study = {"variants": [], "over": {"arm.mass": [1, 2]}, "samples": 2}
    before = {"generator": "asrsim 0", "format": 4, "scenario": "s.yaml", "plugins": [], "study": study, "versions": {},
              "inputs": {"s": {"arm.urdf": "a", "seen.csv": "b"}}, "columns": [("run", "int", "")], "claims": {},
              "substeps": {}, "runs": 2}  # fmt: skip
    open_store(tmp_path, before, resume=False, overwrite=False)
    open_store(tmp_path, before, resume=True, overwrite=False)
    inputs = {"s": {"arm.urdf": "a", "seen.csv": "c"}, "another variant": {"new.csv": "d"}}
    now = {**before, "study": {**study, "samples": 3}, "inputs": inputs}
    with pytest.raises(InputError, match=r"other values of samples; its inputs have changed: seen\.csv, new\.csv\."):
        open_store(tmp_path, now, resume=True, overwrite=False)


def test_a_full_disk_keeps_what_is_written(tmp_path, monkeypatch):
    store = Store(tmp_path, [("run", "int", "")], 10)
    store.add([(0,), (1,)])
    store.write()
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OutputError, match=r"No space left.*2 rows are kept"):
        # Sooner where 3 s have gone.
        store.write() if store.add([(2,)]) else None
    monkeypatch.undo()
    assert list(Store(tmp_path, [("run", "int", "")], 10).missing) == list(range(2, 10))


def manifest_of(runs, *floats, **study):
    """The description of a study with these columns of numbers."""
    columns = [("run", "int", ""), ("variant", "text", ""), ("status", "text", ""), *((name, "float", "") for name in floats)]
    return {
        "generator": "asrsim test", "scenario": "a.yaml", "plugins": [], "study": {"name": "a", "variants": ["a"], **study},
        "inputs": {}, "versions": {}, "runs": runs, "columns": columns, "claims": {"a": []}, "substeps": {"a": {}},
    }  # fmt: skip


SMALL = manifest_of(3, "value")


def small_study(folder):
    store = open_store(folder, SMALL, resume=False, overwrite=False)
    store.add([(run, "a", "complete", run / 7) for run in range(3)])
    store.finish()
    return folder / "rows.parquet"


def test_an_edited_manifest_is_refused_or_leaves_the_rows_unchanged(tmp_path):
    small_study(tmp_path)
    manifest, told = tmp_path / "study.json", []
    for other in edits(json.loads(manifest.read_text()), seed=5, most=80):
        manifest.write_text(json.dumps(other))
        try:
            table = Table(tmp_path)
            assert [table[name] for name in table.columns][-1].tolist() == [0.0, 1 / 7, 2 / 7]
            study_data(table), table.to_arrow()
        except InputError as error:
            told.append(str(error))
    assert len(told) > 30
    assert all(str(manifest) in message for message in told)


def test_damaged_rows_are_refused_or_read_as_written(tmp_path):
    """Flipped bits, and bytes that are missing or too many: never other numbers, and never fewer."""
    rows = small_study(tmp_path)
    whole, source, damaged = rows.read_bytes(), random.Random(5), []
    for number in range(1, 401):
        spot, data = source.randrange(len(whole)), bytearray(whole)
        if number % 2:
            data[spot] ^= 1 << source.randrange(8)
        else:
            data[spot : spot + source.choice((0, 1, 2))] = source.randbytes(source.choice((0, 1, 3)))
        damaged.append(tmp_path / f"part-{number:06d}.parquet")
        damaged[-1].write_bytes(data)
    with pytest.raises(InputError) as caught:
        Table(tmp_path)
    told = {problem.file for problem in caught.value.problems}
    assert len(told) > 300
    assert rows not in told
    for path in damaged:
        if path not in told:
            assert pq.read_table(path).to_pydict() == pq.read_table(rows).to_pydict()


def test_rows_that_would_fill_the_memory_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("asrsim.sweeps.store.MEMORY", 2**29)
    rows = small_study(tmp_path)
    schema, count = pq.read_schema(rows), 1000
    with pq.ParquetWriter(rows, schema, compression="zstd") as writer:
        table = pa.table([np.zeros(count, int), *[["x" * 10**5] * count] * 2, np.zeros(count)], schema=schema)
        for _ in range(4):
            writer.write_table(table)
    assert rows.stat().st_size < 10**6
    with pytest.raises(InputError, match=r"rows\.parquet.*memory"):
        Table(tmp_path)


def test_large_rows_that_their_file_holds_are_read(tmp_path, monkeypatch):
    """The memory that a check may use grows with the size of the files."""
    monkeypatch.setattr("asrsim.sweeps.store.MEMORY", 2**29)
    rows = small_study(tmp_path)
    schema = pq.read_schema(rows)
    texts = [np.random.default_rng(seed).bytes(50_000).hex() for seed in range(200)]
    pq.write_table(pa.table([np.arange(200), texts, texts, np.zeros(200)], schema=schema), rows, use_dictionary=False)
    assert rows.stat().st_size > 2 * 10**7
    assert len(Table(tmp_path)) == 200


def test_rows_come_once_and_in_order_whatever_the_parts(tmp_path):
    manifest = manifest_of(1000, "value")
    store = open_store(tmp_path, manifest, resume=False, overwrite=False)
    runs = list(range(1000))
    random.Random(0).shuffle(runs)
    for first in range(0, 1000, 90):
        store.add([(run, "a", "complete", run / 7) for run in runs[first : first + 90]])
        store.write()
        assert store.add([(runs[first], "a", "complete", 0.0)]) == []
    store.finish()
    table = Table(tmp_path)
    assert list(table["run"]) == list(range(1000))
    np.testing.assert_array_equal(table["value"], np.arange(1000) / 7)
    found = table.quantiles("value")
    assert (found.count, found.median, found.least_run, found.largest_run) == (1000, 499.5 / 7, 0, 999)
    assert not list(tmp_path.glob("part-*"))
    assert Store(tmp_path, manifest["columns"], 1000).missing == []


def test_all_runs_take_the_substeps_of_the_most_demanding():
    """These are the lightest motors. Substeps that the scenario states stay."""
    inertias = (0.03, 3e-4, 0.02)
    study = study_of({"parameters.*.motor_1_inertia": list(inertias)})
    alone = set()
    for one in inertias:
        own = [*SHORT, f"parameters.*.motor_1_inertia={one}"]
        alone.add(prepare(asrsim.load_scenario(TWO_JOINTS, variant="soft", overrides=own)[0]).resolution.motor_substeps)
    assert len(alone) > 1
    assert make_payload(study).cases["soft"].substeps["motor_substeps"] == max(alone)
    told = study_of({"parameters.*.motor_1_inertia": list(inertias)}, overrides=[*SHORT, "motor_substeps=20"])
    assert "motor_substeps" not in make_payload(told).cases["soft"].substeps
    assert make_payload(study_of({"substeps": [1, 3]})).cases["soft"].substeps == {}


def test_sobol_indices_of_a_function_with_interactions(tmp_path):
    """Ishigami's function (1990), whose indices are closed forms."""
    table = designed(tmp_path, 2048, lambda x, y, z: {"it": np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)})
    found = {one.key: one.sobol[:2] for one in influences(table, "it")}
    for key, both in {"a.x": (0.3139, 0.5576), "a.y": (0.4424, 0.4424), "a.z": (0.0, 0.2437)}.items():
        assert found[key] == pytest.approx(both, abs=0.02)


def test_an_influence_compares_the_lowest_and_highest_fifth(tmp_path):
    first = influences(designed(tmp_path, 256, lambda x, y, z: {"it": x}), "it")[0]
    assert first.key == "a.x"
    assert (first.low, first.high) == pytest.approx((-0.8 * np.pi, 0.8 * np.pi), abs=0.02)


def designed(folder, samples, results_of, missing=()):
    """A finished study of a Saltelli design over three keys; missing: runs without a row."""
    over = dict.fromkeys(["a.x", "a.y", "a.z"], "uniform(-3.141592653589793, 3.141592653589793)")
    how = {"over": over, "sampler": "saltelli", "samples": samples}
    x, y, z = study_of(**how).table.T
    results = results_of(x, y, z)
    store = open_store(folder, manifest_of(len(x), *over, *results, **how), resume=False, overwrite=False)
    rows = enumerate(zip(x, y, z, *results.values(), strict=True))
    store.add([(run, "a", "complete", *row) for run, row in rows if run not in missing])
    store.finish()
    return Table(folder)


def test_sobol_indices_leave_out_base_samples_with_empty_results(tmp_path):
    """Three empty values and two missing rows in four base samples: the shares of a sum's variance remain."""

    def results(x, y, z):
        total = 3.0 * x - 2.0 * y
        total[[7, 7 + 3 * 256, 5 + 256]] = np.nan
        return {"sum": total}

    table = designed(tmp_path, 256, results, missing={0, 300})
    found = sobol(table, "sum")
    assert (found.samples, found.left_out, found.reason) == (256, 4, "")
    for key, share in {"a.x": 9 / 13, "a.y": 4 / 13, "a.z": 0.0}.items():
        index = found.indices[key]
        assert index[:2] == pytest.approx((share, share), abs=0.03)
        assert abs(index.first - share) <= index.first_error
        assert abs(index.total - share) <= index.total_error
    assert any("without 4 of 256 base samples" in line for line in remarks(table))


@pytest.mark.filterwarnings("error")
def test_a_result_that_is_the_same_in_most_base_samples_has_no_sobol_indices(tmp_path):
    """Many resamples contain none of the two samples with another value, so that the intervals are unknown."""
    table = designed(tmp_path, 64, lambda x, y, z: {"peak": np.where(np.arange(len(x)) % 64 < 2, x, 0.5)})
    found = sobol(table, "peak")
    assert (found.indices, found.reason) == ({}, "the result is the same in the runs of most base samples")
    assert any("peak: no Sobol indices: the result is the same in the runs of most" in line for line in remarks(table))


def test_the_data_of_a_study_contain_the_sobol_indices(tmp_path):
    table = designed(tmp_path, 64, lambda x, y, z: {"sum": 3.0 * x - 2.0 * y})
    data = study_data(table, ["sum"])["sobol"]["sum"]
    assert data == {key: index._asdict() for key, index in sobol(table, "sum").indices.items()}
    assert list(data["a.x"]) == ["first", "total", "first_error", "total_error"]
    assert data["a.x"]["first"] == pytest.approx(9 / 13, abs=0.1)


def test_results_are_ordered_by_varied_joint_and_relative_change(tmp_path):
    results = {
        "tip.last": [1.0, 2.0, 3.0],
        "b.peak": [5.0, 6.0, 7.0],
        "a.small": [1.0, 1.1, 1.2],
        "a.large": [0.1, 0.2, 1.0],
        "a.overshoot": [0.0, 1e-16, 3e-16],
        "claim_0.measured": [1.0, 5.0, 9.0],
    }
    whole = manifest_of(3, "a.mass", *results, over={"a.mass": [0, 1, 2]})
    store = open_store(tmp_path, whole, resume=False, overwrite=False)
    store.add([(run, "a", "complete", float(run), *(values[run] for values in results.values())) for run in range(3)])
    store.finish()
    assert varying(Table(tmp_path)) == ["a.large", "a.small", "tip.last", "b.peak"]
    assert result_rows(Table(tmp_path))[0][2:] == ("3", "0.1", "0.11", "0.2", "0.92", "1", "run 0", "run 2")


def test_the_measured_value_of_a_claim_is_a_result_that_names_the_claim(tiny, asrsim_command):
    """So a measure of a user's own becomes a result of a study."""
    claim = "expect=[{joint: elbow, quantity: link_position, measure: maximum, comparison: '<', value: 9}]"
    done = asrsim_command(
        "sweep", tiny.scenario, "--over", "arm.mass=[0.2, 0.6]", "--set", "duration=0.1", "--set", claim,
        "--out", "study", "--workers", "1", "--result", "claim_0.measured",
    )  # fmt: skip
    assert done.code == 0, done.err
    (row,) = [line for line in done.out.splitlines() if "claim_0" in line]
    assert re.split(r"\s{2,}", row.strip())[0] == "claim_0.measured (elbow link_position: maximum)"
    assert Table("study").unit("claim_0.measured") == "rad"
    assert Table("study").claims() == {"elbow link_position: maximum < 9": 1.0}
    assert "overshoot" not in done.out
    assert over_key(Table("study"), "claim_0.measured").words == "elbow link_position: maximum"


SIGNALS = {
    "references.joint_1.equilibrium_position.sinusoid.amplitude": [0.1, 0.2, 0.3],
    "external_torques.joint_2.step.to": [0.0, 0.2],
}


def signal_scenario(folder, **keys):
    robot = EXAMPLES.parent / "urdf" / "dof2_vertical.urdf"
    data = {
        "robot": str(robot),
        "duration": 0.1,
        "engine": "mujoco",
        "references": {
            "joint_1": {"equilibrium_position": {"sinusoid": {"amplitude": 0.3, "frequency": 5.0}}, "stiffness_preset": 0.3},
            "joint_2": {"equilibrium_position": {"step": {"at": 0.02, "to": 0.1}}, "stiffness_preset": 0.3},
        },
        "external_torques": {"joint_2": {"step": {"at": 0.05, "to": 0.1}}},
        **keys,
    }
    path = folder / "signals.yaml"
    path.write_text(json.dumps(data))
    return path


def test_numbers_inside_signals_vary_without_preparing_the_scenario_anew(tmp_path, monkeypatch):
    """The rows are those of runs that are prepared anew; after the first run nothing is prepared."""
    payload = make_payload(study_of(SIGNALS, signal_scenario(tmp_path), overrides=[]))
    expected = [fresh_row(payload, run) for run in range(6)]
    runner = Runner(payload)
    runner(0)
    monkeypatch.setattr("asrsim.sweeps.cases.prepare", None)
    for rows in ([runner(run) for run in range(6)], runner.several(range(6))):
        cells = [cells_of(payload, row) for row in rows]
        assert [{key: row[key] for key in one} for row, one in zip(cells, expected, strict=True)] == expected
    runner.close()


def test_references_by_inverse_dynamics_are_planned_anew_in_every_run(tmp_path):
    """A heavier link gets other inputs: a row has the numbers of `asrsim run` with the same setting."""
    wanted = {"equilibrium_position": {"minimum_jerk": {"duration": 0.1, "to": 0.2}}, "stiffness_preset": 0.3}
    path = signal_scenario(tmp_path, references={"*": wanted}, inverse_dynamics=True)
    payload = make_payload(study_of({"parameters.*.spring_k_1": [0.02, 0.04]}, path, overrides=[]))
    runner = Runner(payload)
    for run in range(2):
        row, fresh = cells_of(payload, runner(run)), fresh_row(payload, run)
        assert {key: row[key] for key in fresh} == fresh
    runner.close()


def test_a_long_study_has_few_files(tmp_path, monkeypatch):
    """Rows are written every few seconds: a day would have thousands of files."""
    pytest.importorskip("pyarrow")
    from asrsim.sweeps import store

    monkeypatch.setattr(store, "PATIENCE", -1.0)
    columns, total = [("run", "int", ""), ("value", "float", "rad")], 200
    kept = store.Store(tmp_path, columns, total)
    most = 0
    for run in range(total - 1):
        kept.add([(run, 0.5 * run)])
        most = max(most, len(store.parts_of(tmp_path)))
    assert most <= store.MOST_PARTS
    again = store.Store(tmp_path, columns, total)
    assert again.missing == [total - 1]
    again.add([(total - 1, 1.0)])
    again.finish()
    assert not store.parts_of(tmp_path)
    schema = store.schema_of(columns)
    rows = store.read_rows(store.checked_files(tmp_path, schema), schema)
    np.testing.assert_array_equal(rows["run"].to_numpy(), np.arange(total))
    np.testing.assert_array_equal(rows["value"].to_numpy()[:-1], 0.5 * np.arange(total - 1))
