"""Keys of a scenario by the names of the last version: they work in this version, and warn with their place."""

import warnings

import pytest

import asrsim
from asrsim.renamed import OldKeyWarning
from asrsim.scenario import load_scenario, make_scenario, scenario_from_data
from asrsim.sweeps.study import present_name

TEXT = """robot: arm.urdf
duration: 1
effects: {commands: {"*": {delay: 0.01}}}
variants:
  late: {effects: {commands: {"*": {delay: 0.02}}}}
  fine: {substep_cap: 50}
"""


def test_old_keys_of_a_file_have_the_same_meaning(tmp_path):
    (tmp_path / "old.yaml").write_text(TEXT)
    new = TEXT.replace("effects", "imperfections").replace("substep_cap", "max_substeps")
    (tmp_path / "new.yaml").write_text(new)
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")
    with pytest.warns(OldKeyWarning) as told:
        old = load_scenario(tmp_path / "old.yaml")
    assert {one.filename for one in told} == {__file__}, "the warnings name the line of the caller"
    for place in ("3: the key `effects` is", "5: the key `effects` is", "6: the key `substep_cap` is"):
        assert any(f"old.yaml:{place} called" in str(one.message) for one in told)
    expected = load_scenario(tmp_path / "new.yaml")
    for one, other in zip(old, expected, strict=True):
        assert (one.command_imperfections, one.max_substeps) == (other.command_imperfections, other.max_substeps)
        assert {**one.resolved, "name": ""} == {**other.resolved, "name": ""}
        assert one.lines == other.lines


def test_a_key_by_both_names_is_an_error(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")
    (tmp_path / "both.yaml").write_text("robot: arm.urdf\nduration: 1\nsubstep_cap: 5\nmax_substeps: 6\n")
    with pytest.raises(asrsim.InputError, match=r"both\.yaml:3: substep_cap: unknown key.*'max_substeps', which is given"):
        load_scenario(tmp_path / "both.yaml")
    with pytest.raises(asrsim.InputError, match="substep_cap: unknown key"):
        make_scenario(tmp_path / "arm.urdf", duration=1, substep_cap=5, max_substeps=6)


def test_old_keys_of_overrides_keywords_and_axes(tiny):
    with pytest.warns(OldKeyWarning, match="the key `substep_cap` is called `max_substeps` now"):
        assert make_scenario(tiny.robot, duration=1, substep_cap=7).max_substeps == 7
    with pytest.warns(OldKeyWarning):
        late = scenario_from_data({"robot": str(tiny.robot), "duration": 1}, overrides=["effects.sensors.*.delay=0.1"])
    assert late.sensor_imperfections["*"].delay == 0.1
    with pytest.warns(OldKeyWarning):
        assert present_name("effects.sensors.*.delay") == "imperfections.sensors.*.delay"


def test_the_scenario_of_an_old_log_is_read_without_a_warning(tiny):
    data = {"robot": str(tiny.robot), "duration": 1.0, "effects": {"sensors": {"*": {"noise": 0.1}}}}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert scenario_from_data(data).sensor_imperfections["*"].noise == 0.1
