"""Sag of an arm under its own weight, from the positions at which springs, motors and gravity balance at the references of a
scenario.

The motors stand at their references minus the steady-state error of their controllers under load. Motor torques are limited to
the largest torque at rest, and joint torques to the effort limit. The friction of the motors is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.rest import MotorsAtRest, alike, resting_motors
from asrsim.actuators.vectorised import over_arrays
from asrsim.robot import ActuatorBlock, Joint, Robot
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.mounting import drive_of
from asrsim.samples import Array
from asrsim.scenario.data import for_joint
from asrsim.scenario.starts import start_positions
from asrsim.statics.balance import Loads, balanced, by_differences

if TYPE_CHECKING:
    from asrsim.actuators.drive import Drive
    from asrsim.scenario.data import Scenario

FALL = 1.0
"""Sag above which a joint counts as falling, as a fraction of the joint's scale."""
SLIDING = 0.2
"""Displacement of a prismatic joint that counts as much as 1 rad of a revolute joint, m: the tip of a link of this length moves
as far."""
OFF = 0.1
"""Distance from the reference, as a fraction of the joint's scale, above which a joint at a stop has fallen onto the stop."""
INSTANTS = 8
"""Largest number of instants of a run that are checked."""
CLOSE = 1e-3
"""Distance from the position of rest at which the search for this position ends, rad (m); sags are printed with two digits."""
SHOVE = 0.1
"""Displacement by which the search leaves an unstable equilibrium, rad (m). It is large, since an arm falls far from an
unstable equilibrium."""
SAG = 0.3
"""Sag above which a joint gets a warning, rad; every soft arm sags a little. For a prismatic joint, or a travel below 1 rad,
the value is a fraction of the joint's scale (see `Holding.scale`)."""
SHORT = 0.01
"""Travel below which a joint counts as fixed, as a fraction of the usual scale: 1 rad, or `SLIDING` for a prismatic joint."""


@dataclass(frozen=True, kw_only=True)
class Holding:
    """Sag of a joint under the arm's weight at the scenario's references, and its causes."""

    joint: str
    sag: float
    """Largest distance between the commanded position and the position of rest, rad or m."""
    load: float
    """Gravity load on the joint at the commanded position and the instant `time`, N m or N."""
    on_stop: bool
    """Whether the joint rests at a stop although its reference is elsewhere."""
    limited: bool
    """Whether a motor gives its largest torque."""
    overloaded: bool
    """Whether the joint's effort limit clips the torque of its springs."""
    time: float
    """Instant of the largest sag, s."""
    scale: float
    """Scale for the sag of this joint, rad or m: 1 rad, `SLIDING`, or the joint's travel if the travel is shorter."""
    droop: float
    """Part of the sag that the steady-state error of the motor controllers causes, rad or m."""

    @property
    def falls(self) -> bool:
        """Whether the joint falls instead of sagging a little."""
        return self.on_stop or self.sag > FALL * self.scale

    @property
    def weak(self) -> bool:
        """Whether the joint sags too much, or comes to rest on a stop."""
        return self.on_stop or self.sag > SAG * self.scale


@np.errstate(all="ignore")
def holdings(scenario: Scenario, robot: Robot, model: RobotModel) -> tuple[Holding, ...]:
    """Largest sag over time of each joint with a spring. The sag is the distance from the commanded position to the position of
    rest.

    robot: the robot with the scenario's modes and parameters; model: its model. Floating bases, modes without springs, torque,
    voltage and current references are left out, and so are references that already account for the weight (of a task, of
    learning, or of a joint with a `desired` motion).
    """
    blocks = _sagging(scenario, robot)
    if not blocks:
        return ()
    statics = _Statics(scenario, robot, model, blocks)
    wanted, couplings, columns = statics.wanted, statics.couplings, [*statics.drives]
    movable = np.isin(np.arange(len(model.joints)), couplings.master[columns])
    positions, _ = balanced(
        statics.weights(movable), statics.springs, wanted, model.lower, model.upper, movable, close=CLOSE, shove=SHOVE
    )
    positions = couplings.expand(positions)
    sags, loads = np.abs(positions - wanted)[:, columns], -model.gravity_torques(wanted)[:, columns]
    worst, rows = sags.argmax(axis=0), np.arange(len(columns))
    links = positions[:, columns][worst, rows]
    joints, drives, references = zip(*statics.drives.values(), strict=True)
    found: dict[int, Holding] = {}
    for group in alike(drives):
        goals = np.stack([references[row][:, worst[row]] for row in group], axis=1)[..., None]
        resting, own = resting_motors([drives[row] for row in group], links[group, None], goals)
        motors = drives[group[0]].actuator.motors
        pulls, droops = own[..., 0].T, np.abs((goals - resting)[:motors, :, 0].mean(axis=0)).tolist()
        for row, pull, droop in zip(group, pulls, droops, strict=True):
            joint, sag, scale = joints[row], float(sags[worst[row], row]), scale_of(joints[row])
            stopped = np.abs(links[row] - joint.stops).min() < 1e-6
            most = np.array(drives[row].max_torque or np.inf)
            found[row] = Holding(
                joint=joint.name,
                sag=sag,
                load=float(loads[worst[row], row]),
                time=float(statics.time[worst[row]]),
                scale=scale,
                on_stop=bool(stopped and sag > OFF * scale),
                limited=bool(np.any(np.abs(pull[:motors]) > (1.0 - 1e-6) * most)),
                overloaded=bool(abs(pull.sum()) > joint.most_effort),
                droop=droop,
            )
    return tuple(found[row] for row in range(len(columns)))


class _Statics:
    """Springs and weight of an arm at the instants of a scenario that are checked."""

    def __init__(self, scenario: Scenario, robot: Robot, model: RobotModel, blocks: list[ActuatorBlock]) -> None:
        self.model, self.time = model, _instants(scenario, blocks)
        wanted = np.tile([*start_positions(scenario, robot).values()], (len(self.time), 1))
        self.drives: dict[int, tuple[Joint, Drive, Array]] = {}
        """Joint, drive, and positions of its motors at the instants (positions, instants), by column of the joint."""
        for block in blocks:
            column, joint = model.joints.index(block.joint), robot.joint(block.joint)
            goals, goal = goals_of(scenario, block, self.time)
            self.drives[column] = joint, drive_of(block), goals
            wanted[:, column] = np.clip(goal, *joint.stops)
        self.couplings = model.couplings
        self.wanted = self.couplings.expand(wanted)
        """Commanded positions (instants, joints), rad or m."""
        rows = [*self.drives.values()]
        self._efforts = np.array([joint.most_effort for joint, *_ in rows])
        self._motors = [
            (group, MotorsAtRest([rows[i][1] for i in group], np.stack([rows[i][2] for i in group], axis=1)))
            for group in alike([drive for _, drive, _ in rows])
        ]
        """A pair for each kind of drive: indices of its joints among the joints of `drives`, and the motors of these joints at
        rest."""

    def weights(self, movable: NDArray[np.bool_]) -> Loads:
        """Torques of gravity on the links in N m. movable: joints that may move."""
        if self.couplings:
            return by_differences(lambda q: -self.model.gravity_torques(q), movable)

        def weighing(q: Array) -> tuple[Array, Array]:
            torques, stiffness = self.model.gravity_stiffness(q)
            return -torques, -stiffness

        return weighing

    def springs(self, positions: Array) -> tuple[Array, Array]:
        """Torques (instants, joints) in N m of the springs on the links, and their changes per displacement of their joints, in
        the steps of one search by Newton's method; see `MotorsAtRest.follow`."""
        q, columns = self.couplings.expand(positions), [*self.drives]
        links = q[:, columns].T
        torques, changes = np.empty_like(links), np.empty_like(links)
        for group, motors in self._motors:
            torques[group], changes[group] = motors.follow(links[group])
        found = np.zeros((2, *q.shape))
        found[0][:, columns] = np.clip(torques.T, -self._efforts, self._efforts)
        found[1][:, columns] = np.where(np.abs(torques.T) < self._efforts, changes.T, 0.0)
        return self.couplings.fold(found[0], q), self.couplings.fold_gains(found[1], q)


def goals_of(scenario: Scenario, block: ActuatorBlock, time: Array) -> tuple[Array, Array]:
    """Commanded positions at `time`: motors and adjuster (positions, n), and link (n,)."""
    actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
    given = scenario.references_of(block.joint)
    rest = np.full(len(time), float(for_joint(scenario.initial_positions, block.joint, 0.0)))
    goals = []
    for slot, name in enumerate(mode.references_of(actuator.motors)):
        idle = np.zeros(len(time)) if slot and (mode.mapped or actuator.adjuster or actuator.is_housed(slot)) else rest
        goals.append(np.asarray(given[name].values(time), dtype=float) if name in given else idle)
    if mode.mapped:
        return over_arrays(actuator.motor_references)(goals[0], goals[1]), goals[0]
    return np.stack(goals), goals[0] if actuator.motors < 2 else over_arrays(actuator.equilibrium_position)(*goals)


def _instants(scenario: Scenario, blocks: list[ActuatorBlock]) -> Array:
    """Instants (n,) to check, s: the start, the end, and a choice of the extremes of the references."""
    grid = np.linspace(0.0, scenario.duration, 101)
    chosen = {0, len(grid) - 1}
    for block in blocks:
        for signal in scenario.references_of(block.joint).values():
            values = signal.values(grid)
            chosen |= {int(np.argmin(values)), int(np.argmax(values))}
    kept = np.linspace(0, len(chosen) - 1, min(len(chosen), INSTANTS)).round().astype(int)
    return np.asarray(grid[np.array(sorted(chosen))[kept]])


def _sagging(scenario: Scenario, robot: Robot) -> list[ActuatorBlock]:
    """Actuators whose springs must hold the arm at their references; see `holdings`."""
    if not scenario.fixed_base or not any(scenario.gravity):
        return []
    return [
        block
        for block in sprung(robot)
        if not scenario.computes_reference(block.joint) and for_joint(scenario.desired, block.joint) is None
    ]


def sprung(robot: Robot) -> list[ActuatorBlock]:
    """Actuators with a spring and a position as reference."""
    return [block for block in robot.actuators if MODES[block.mode].spring and not MODES[block.mode].direct]


def scale_of(joint: Joint) -> float:
    """Scale for the sag of a joint, rad or m. The travel of the joint limits the scale, unless the travel is so short that the
    joint cannot sag."""
    low, high = joint.stops
    usual = SLIDING if joint.kind == "prismatic" else 1.0
    return min(usual, high - low) if high - low > SHORT * usual else usual
