"""`plot` of the scenario that `identify` wrote, beside the recording that it was fitted to, shows the error that it printed."""

import json

import numpy as np
import pytest

import asrsim
from asrsim.plots.job import PlotJob, plot
from support.tiny import PENDULUM

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("actuator", "delay", "late", "presets"),
    [("sea", 0.03, 0.0, False), ("sea", 0.0, 0.0, False), ("sea", 0.03, 120.5, False), ("qbmove", 0.03, 0.0, False),
     ("qbmove", 0.02, 3.0, True)],
)  # fmt: skip
def test_the_error_of_a_fit_is_the_error_of_its_plot(tmp_path, asrsim_command, actuator, delay, late, presets):
    """A recording of one reference, or of both, with noise of .5 mrad, by a clock of its own."""
    (tmp_path / "arm.urdf").write_text(
        PENDULUM.replace("libsea", f"lib{actuator}").replace("<operation_mode>3", "<operation_mode>6").replace("_k>10", "_k>12")
    )
    motion = [
        {"sinusoid": {"amplitude": 0.3, "frequency": 0.7}},
        {"step": {"at": 1, "to": 0.2}},
        {"step": {"at": 2.3, "to": -0.3}},
    ]
    references = {"equilibrium_position": {"sum": motion}}
    if actuator != "sea":
        preset = {"sinusoid": {"amplitude": 0.05, "frequency": 0.4, "offset": 0.2}}
        references["stiffness_preset"] = preset if presets else 0.2
    effects = {"commands": {"elbow": {"delay": delay}}} if delay else {}
    samples = asrsim.run(
        asrsim.make_scenario(tmp_path / "arm.urdf", duration=4, references={"elbow": references}, effects=effects)
    ).samples
    sent = "sent_reference" if delay else "reference"
    columns = {"time": samples.time + late, "elbow_cmd": samples.values[f"{sent}_1"][:, 0]}
    noise = 5e-4 * np.random.default_rng(1).standard_normal(len(samples.time))
    columns["elbow_pos"] = samples.values["link_position"][:, 0] + noise
    if presets:
        columns["elbow_preset"] = samples.values[f"{sent}_2"][:, 0]
    table = np.column_stack([*columns.values()])[::4]
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    assert asrsim_command("init", "arm.urdf", "--experiment", "lab.csv", "--out", "s.yaml").code == 0
    scenario = tmp_path / "s.yaml"
    lines = ["    stiffness_preset: 0.2" if line.startswith("    stiffness_preset: ") and not presets else line
             for line in scenario.read_text().splitlines()]  # fmt: skip
    scenario.write_text("\n".join(lines) + "\n")
    free = [f"--free=elbow.{name}" for name in ("damping", "reference_1.delay", *(["reference_2.delay"] if presets else []))]
    assert asrsim_command("identify", "s.yaml", "--experiment", "lab.csv", *free, "--out", "fit", "--no-plot").code == 0
    (path,) = tmp_path.rglob("fit.json")
    (channel,) = json.loads(path.read_text())["channels"]
    assert asrsim_command("run", path.parent / "scenario.yaml", "--no-plot", "--out", "again").code in (0, 1)
    (log,) = (tmp_path / "again").rglob("log.mcap")
    (compared,) = plot(PlotJob(logs=(log,), folder=tmp_path, experiments=(str(tmp_path / "lab.csv"),))).compared
    assert compared.alignments[str(tmp_path / "lab.csv")].lag == pytest.approx(late, abs=1e-5)
    # A quarter of the recording is held out.
    printed = np.sqrt(0.75 * channel["after"] ** 2 + 0.25 * channel["held_after"] ** 2)
    assert compared.pairs["elbow", "link_position"].rmse == pytest.approx(printed, rel=0.03)
