"""Parts of an examination, for tests of single checks."""

from asrsim.errors import ScenarioError
from asrsim.scenario.check import misfits
from asrsim.scenario.doubts import doubts
from asrsim.simulation.examine import examine
from asrsim.summary.claims import claim_problems


def check_against_robot(scenario, robot):
    """Pair (errors, warnings) about a scenario and the robot of its file."""
    changed, faults, errors = misfits(scenario, robot)
    errors = [scenario.placed(problem) for problem in (*faults, *errors)]
    return errors, [] if errors or scenario.unread or changed is None else [*doubts(scenario, changed)]


def checked_robot(scenario, robot=None):
    """Robot of a scenario's file, and all warnings. Raises RobotError and ScenarioError."""
    plan = examine(scenario, robot)
    return plan.source, [*plan.warnings]


def check_claims(claims, joints, *, file):
    """Raise ScenarioError for claims that cannot be evaluated."""
    if problems := claim_problems(claims, joints, file=file):
        raise ScenarioError(problems)
