"""What must hold for a robot that `asrsim check` accepts: `init` writes a scenario, and a run agrees in both engines."""

import asrsim
from asrsim.cli.findings import robot_report
from asrsim.scenario import load_scenario
from asrsim.starter.robot import write_starter

ACTUATORS = ("sea", "qbmove", "bavs", "awas_ii")


def faults_of(robot, folder, actuator, *, duration=1.0, at_rest=False, compiled=True):
    """Texts of what went wrong between `check` and the end of the run with another engine; None where `check` refuses the
    robot. at_rest: without the step of the references."""
    if robot_report(robot).errors:
        return None
    out = folder / f"{robot.stem}_{actuator}.yaml"
    write_starter(robot, out, actuators={"*": actuator}, force=True)
    found = []
    for scenario in load_scenario(
        out, overrides=[f"duration={duration}", f"compiled={compiled}".lower(), *_resting(out, at_rest=at_rest)]
    ):
        result = asrsim.run(scenario, cross_check=True)
        check = result.summary.cross_check
        if result.status != "complete" or not check or not check["agrees"] or "cannot run" in check["note"]:
            found.append(f"{scenario.variant}: {result.status} {check and (check['finding'] or check['note'])}")
    return found


def _resting(out, *, at_rest):
    """Overrides that keep every reference at its first value."""
    if not at_rest:
        return []
    first = load_scenario(out)[0]
    return [
        f"references.{joint}.{name}={float(signal.values(0.0))!r}"
        for joint, signals in first.references.items()
        for name, signal in signals.items()
    ]
