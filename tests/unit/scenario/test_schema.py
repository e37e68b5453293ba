"""The JSON Schema and the documentation's tables follow from the declarations."""

import json
import re

import pytest
import yaml
from jsonschema import Draft202012Validator

from asrsim.document.yaml_reader import parse_yaml
from asrsim.errors import ScenarioError
from asrsim.scenario import load_scenario, scenario_from_data
from asrsim.scenario.data import KEYS
from asrsim.scenario.schema import json_schema
from asrsim.signals import parse_signal
from support.paths import ROOT

EXAMPLES = sorted((ROOT / "examples" / "scenarios").glob("*.yaml"))


@pytest.fixture(scope="module")
def validator():
    Draft202012Validator.check_schema(json_schema())
    return Draft202012Validator(json_schema())


def test_every_key_is_described():
    assert all(key.doc for key in KEYS)
    assert all(key["description"] for key in json_schema()["properties"].values())


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_valid_under_the_schema_too(validator, path):
    data = json.loads(json.dumps(_numbers(yaml.safe_load(path.read_text(encoding="utf-8")))))
    assert [error.message for error in validator.iter_errors(data)] == []
    assert load_scenario(path)


def _numbers(data):
    """PyYAML's YAML 1.1 takes 1e-3 for text; editors do not."""
    if isinstance(data, dict):
        return {str(key): _numbers(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_numbers(value) for value in data]
    try:
        return float(data) if isinstance(data, str) else data
    except ValueError:
        return data


@pytest.mark.parametrize(
    ("keys", "valid"),
    [
        ({}, True),
        ({"references": {"a": {"b": {"sum": [1, {"delay": {"by": 0.1, "of": {"step": {"to": 1}}}}]}}}}, True),
        ({"variants": {"a": {}, "b": {"duration": 2}, "c": None}}, True),
        ({"parameters": {"a": {"motor_1_max_position": "inf"}}}, True),
        (
            {
                "variants": {"a": {"references": {"j": {"r": {"step": {"to": 2}}}}, "world": None}},
                "references": {"j": {"r": 1}},
            },
            True,
        ),
        (
            {"task": {"link": "a", "poses": [{"time": 1, "position": [0, 0, 0]}]}, "variants": {"a": {"task": {"preset": 1}}}},
            True,
        ),
        ({"duratoin": 1}, False),
        ({"step": "fast"}, False),
        ({"gravity": [0, 0]}, False),
        ({"references": {"a": {"b": {"stp": {"to": 1}}}}}, False),
        ({"references": {"a": {"b": {"step": {"to": 1}, "ramp": {"to": 1, "duration": 1}}}}}, False),
        ({"variants": {"a": {"duratoin": 1}}}, False),
        ({"variants": {"a": {"duration": "long"}}}, False),
        ({"variants": {"a": {"gravity": [0, 0]}}}, False),
    ],
)
def test_schema_and_reader_agree(validator, tmp_path, keys, valid):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")
    data = {"robot": "arm.urdf", "duration": 1, **keys}
    (tmp_path / "s.yaml").write_text(json.dumps(data))
    assert validator.is_valid(data) == valid
    if valid:
        load_scenario(tmp_path / "s.yaml")
    else:
        with pytest.raises(ScenarioError):
            load_scenario(tmp_path / "s.yaml")


def _fenced(page):
    return re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.DOTALL)


def test_examples_in_the_docs_are_valid(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'/>")
    (tmp_path / "lab.csv").write_text("time,tau\n0,1\n1,2\n")
    scenario, *fragments = _fenced("scenario.md")
    for fragment in fragments:
        assert scenario_from_data({"robot": str(tmp_path / "arm.urdf"), "duration": 1, **parse_yaml(fragment).plain()})
    (tmp_path / "s.yaml").write_text(scenario)
    assert [variant.variant for variant in load_scenario(tmp_path / "s.yaml")] == ["soft", "stiff"]
    (signals,) = _fenced("signals.md")
    for value in parse_yaml(signals).plain().values():
        assert parse_signal(value, base=tmp_path)
