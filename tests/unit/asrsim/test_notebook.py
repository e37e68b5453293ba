"""Results in notebooks: short prints, a table with a picture, a table of pandas, overrides as a mapping."""

import re

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError, ScenarioError
from support.robots import write_plain_arm


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    keys = {"duration": 0.5, "actuators": "qbmove", "references": {"*": {"equilibrium_position": 0.1, "stiffness_preset": 0.3}}}
    return asrsim.run(asrsim.make_scenario(write_plain_arm(tmp_path_factory.mktemp("arm")), **keys))


def test_nothing_prints_at_length(result):
    for thing in (result, result["joint_1"], result.samples, result.run.info, result.run.scenario):
        assert len(repr(thing)) < 4000, type(thing)
    assert "joint_1, joint_2" in repr(result)
    assert "0.5 s" in repr(result)


def test_a_result_shows_a_table_with_a_picture(result):
    shown = result._repr_html_()
    assert shown.count("<tr>") == 3
    assert "joint_2" in shown
    assert "<th>peak defl. rad</th>" in shown
    assert re.search(r'src="data:image/png;base64,iVBOR[\w+/=]{5000,}"', shown)
    assert "\x00" not in shown


def test_names_in_the_table_are_no_markup(result, monkeypatch):
    from dataclasses import replace

    joints = (replace(result.summary.joints[0], name="<script>"), *result.summary.joints[1:])
    odd = replace(result, summary=replace(result.summary, joints=joints))
    assert "<script>" not in odd._repr_html_()


def test_plot_gives_a_figure_of_what_is_asked(result, tmp_path):
    figure = result.plot(joints=["joint_2"], quantities=["link_position", "deflection"])
    assert len(figure.axes) >= 2
    lines = [line for axes in figure.axes for line in axes.get_lines()]
    assert any(np.allclose(line.get_ydata()[-1], result["joint_2"].link_position[-1]) for line in lines)
    with pytest.raises(InputError):
        result.plot(quantities=["link_psition"])


def test_a_notebook_displays_plots_and_film_strips(result):
    """IPython displays objects with `_repr_png_`."""
    for shown in (result.plot(), result.render(frames=3)):
        assert shown._repr_png_().startswith(b"\x89PNG")


def test_pandas_has_the_numbers_of_the_result(result):
    pytest.importorskip("pandas")
    frame = result.to_pandas()
    assert np.array_equal(frame.index.to_numpy(), result.time)
    assert np.array_equal(frame["joint_1"]["link_position"], result["joint_1"].link_position)
    assert ("joint_2", "deflection") in frame.columns


def test_overrides_as_a_mapping_are_those_as_texts(tmp_path):
    write_plain_arm(tmp_path)
    path = tmp_path / "s.yaml"
    path.write_text("robot: arm.urdf\nduration: 1\ngravity: [0, 0, -1]\nvariants: {a: {}, b: {}}\n")
    texts = ["duration=2", "references.joint_1.link_torque=0.5", "gravity="]
    table = {"duration": np.float64(2.0), "references.joint_1.link_torque": 0.5, "gravity": None}
    one, other = (asrsim.load_scenario(path, variant="a", overrides=given)[0] for given in (texts, table))
    assert one.references == other.references
    assert (one.duration, one.gravity) == (other.duration, other.gravity) == (2.0, (0.0, 0.0, -9.81))
    with pytest.raises(ScenarioError, match="cannot be set"):
        asrsim.load_scenario(path, overrides={"variants.a": {}})
    with pytest.raises(ScenarioError, match="unknown key"):
        asrsim.load_scenario(path, overrides={"duraton": 1})
