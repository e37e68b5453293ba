"""A resonance whose oscillation the step makes too fast gets a warning with its error, compared with the closed form."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import UnresolvedSpringError

ARM = """<robot name="arm"><link name="world"/>
<link name="lever"><inertial><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02"/></inertial></link>
<joint name="knee" type="continuous"><parent link="world"/><child link="lever"/><axis xyz="0 1 0"/>
<limit effort="1e4" velocity="1e3"/><dynamics damping="{damping}"/></joint>
<gazebo><plugin name="a" filename="libsea_plugin.so"><joint>knee</joint><operation_mode>4</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau><spring_k>{stiffness}</spring_k>
<mot_J>0.02</mot_J><mot_D>0</mot_D><mot_tauFric>0</mot_tauFric><mot_tauMax>1e3</mot_tauMax><mot_maxVel>inf</mot_maxVel>
</plugin></gazebo></robot>"""
SCENARIO = """robot: arm.urdf
duration: 1
gravity: [0, 0, 0]
external_torques: {knee: 1}
references: {knee: {motor_1_torque: 0}}
"""


def run(folder, omega, damping=0.0, more=""):
    """Error of the deflection of two free masses after 0.9 s, as a fraction of its amplitude, and the warnings of the step."""
    (folder / "arm.urdf").write_text(ARM.format(stiffness=omega**2 * 0.01, damping=damping))
    (folder / "s.yaml").write_text(SCENARIO + more)
    result = asrsim.run(folder / "s.yaml")
    knee = result["knee"]
    amplitude = 1.0 / 0.02 / omega**2
    deflection = knee["link_position"] - knee["motor_1_position"]
    late = result.time >= 0.9
    error = np.abs(deflection - amplitude * (1.0 - np.cos(omega * result.time)))[late].max() / amplitude
    return error, [problem for problem in result.summary.warnings if "resonance" in str(problem)]


@pytest.mark.parametrize(("omega", "expected"), [(150.0, 0.14), (190.0, 0.286)])
def test_an_undamped_resonance_gets_a_warning_with_its_error(tmp_path, omega, expected):
    """Two masses of 0.02 kg m^2 on a spring: omega^3 t h^2 / 24 rad at h = 1 ms."""
    error, (warning,) = run(tmp_path, omega)
    assert error == pytest.approx(expected, rel=0.05)
    assert f"{expected:.2g} rad ahead" in str(warning)
    substeps = str(warning).split("`")[1]
    error, warnings = run(tmp_path, omega, more=f"{substeps}\n")
    assert error < 0.022
    assert not warnings


def test_a_decaying_resonance_is_judged_when_its_error_is_largest(tmp_path):
    """The mode of two equal masses decays with the rate c / (4 I) = 2 /s: its error t exp(-2 t) is largest after 0.5 s."""
    _, (warning,) = run(tmp_path, 250.0, damping=4.0 * 0.02 * 2.0)
    ahead = 250.0**3 * 0.5 * 1e-6 / 24.0 / np.e
    assert f"is {ahead:.2g} rad ahead after 0.5 s" in str(warning)
    assert "resonance at 39.8 Hz is resolved coarsely" in str(warning)
    assert "(omega h = 0.25)" in str(warning)


def test_a_passive_spring_belongs_to_the_resonance(tmp_path):
    """The actuator's spring is soft; the link swings on the spring of its joint at 190 rad/s."""
    spring = f'<gazebo reference="knee"><springStiffness>{0.02 * 190.0**2}</springStiffness></gazebo></robot>'
    (tmp_path / "arm.urdf").write_text(ARM.format(stiffness=1.0, damping=0.0).replace("</robot>", spring))
    (tmp_path / "s.yaml").write_text(SCENARIO)
    (warning,) = [one for one in asrsim.prepare(tmp_path / "s.yaml").warnings if one.code == "resonance"]
    assert "resonance at 30.3 Hz is resolved coarsely" in str(warning)
    assert "(omega h = 0.19)" in str(warning)


def test_a_damped_or_resolved_resonance_gets_no_warning(tmp_path):
    assert not run(tmp_path, 190.0, damping=0.4)[1]
    assert not run(tmp_path, 100.0)[1]


def test_a_spring_that_no_substep_resolves_is_named_with_its_own_stiffness(tmp_path):
    """A soft spring on a light finger, behind a stiff spring on a heavy arm."""
    finger = (
        '<link name="tip"><inertial><mass value="1e-6"/><inertia ixx="1e-9" iyy="1e-9" izz="1e-9"/></inertial></link>'
        '<joint name="finger" type="continuous"><parent link="lever"/><child link="tip"/><axis xyz="0 1 0"/></joint></robot>'
    )
    (tmp_path / "arm.urdf").write_text(ARM.format(stiffness=390, damping=0).replace("</robot>", finger))
    spring = "actuators: {finger: {type: sea, mode: 3, parameters: {spring_stiffness: 10}}}\n"
    (tmp_path / "s.yaml").write_text(SCENARIO + spring)
    with pytest.raises(UnresolvedSpringError, match="'finger' can reach 10 N m/rad"):
        asrsim.run(tmp_path / "s.yaml")
