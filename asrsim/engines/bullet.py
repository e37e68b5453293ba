"""PyBullet behind the engine interface, set up so that its traps do not bite. The only module that imports pybullet.

Undamped unless asked, inertia as in the data, true Coulomb friction of joints, no velocity clamp, no hidden motors, fixed links
merged. What Bullet's step lacks comes from :mod:`asrsim.engines.bullet_companion`. Link damping is the loop's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any
from weakref import finalize, proxy

import numpy as np

from asrsim.engines.base import EngineKernel
from asrsim.engines.bullet_companion import Companion, model_beside, without_stops
from asrsim.engines.bullet_loading import free_of_losses, load_body, set_inertias
from asrsim.engines.bullet_model import BulletModel
from asrsim.engines.bullet_saved import SavedState, disconnect
from asrsim.engines.bullet_world import BulletWorld
from asrsim.engines.foreign import quiet
from asrsim.engines.mujoco_library import overlaps
from asrsim.errors import Problem
from asrsim.robot import engine_urdf
from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint
from asrsim.versions import version

SOLVER_ITERATIONS, SOLVER_RESIDUAL = 500, 1e-18
"""With contacts. Bullet stops at 50 iterations or 1e-7: bodies and joints that should stick then creep, by 1e-4 m/s and
1e-3 rad/s. These leave 1e-9 m/s and 1e-5 rad/s, and cost little, since most steps converge sooner."""
BEYOND = 1e-9
"""rad or m beyond a stop at which a joint rests on it in a world with contacts."""
ARREST = 1e9
"""N m: more than any impact takes."""


def _unpack(states: Any, j: int) -> tuple[float, float]:
    state = states[j]
    return state[0], state[1]


class BulletEngine:
    """A fresh physics client with one robot and its world."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        with quiet():
            import pybullet

            client = pybullet.connect(pybullet.DIRECT)
        self._p, self._client, self._alive = pybullet, client, [True]
        # An engine that nobody closes, of a preparation that is never run, would leave its client's 28 MB behind.
        self._release = finalize(self, disconnect, pybullet, client, self._alive)
        self.version = f"pybullet {version('pybullet')}"
        self.robot = robot
        self._scenario = scenario
        self._step = scenario.step
        merged = merge_fixed(robot)
        held = any(any(joint.frictions) or np.isfinite(joint.stops).any() for joint in robot.moving_joints)
        self._exact = exact = scenario.world.empty and held
        shown = without_stops(merged.robot) if exact else merged.robot
        text, self.warnings = engine_urdf(shown, package_paths=scenario.package_paths)
        try:
            self._body = load_body(pybullet, self._client, text, scenario, robot)
            self._set_up()
            set_inertias(pybullet, self._client, self._body, self._link_index, shown)
            links = {name: (self._link_index[place.body], place.pose) for name, place in merged.places.items()}
            self.model = BulletModel(
                pybullet, self._client, self._body, self._indices, joints=self.joints, gravity=scenario.gravity,
                fixed=scenario.fixed_base, links=links, other=partial(model_beside, scenario, robot),
            )  # fmt: skip
            self._world = BulletWorld(pybullet, self._client, self._body, scenario.world, fixed=scenario.fixed_base)
        except BaseException:
            self.close()
            raise
        p, client, body = self._p, self._client, self._body
        self._read_states = partial(p.getJointStates, body, self._indices, client)
        self._states: Any = None
        self._apply = partial(p.setJointMotorControlArray, body, self._indices, p.TORQUE_CONTROL, physicsClientId=client)
        self._simulate = partial(p.stepSimulation, client)
        self._start = (list(p.getBasePositionAndOrientation(body, client)), self._world.states())
        positions = [float(for_joint(scenario.initial_positions, name, 0.0)) for name in self.joints]
        self.set_state(positions, [0.0] * len(positions))

    # -- setting up -------------------------------------------------------------------------------------------------

    def _set_up(self) -> None:
        p, client, body = self._p, self._client, self._body
        p.setGravity(*self._scenario.gravity, physicsClientId=client)
        self.base = p.getBodyInfo(body, client)[0].decode()
        self._link_index = {self.base: -1}
        index_of = {}
        for index in range(p.getNumJoints(body, client)):
            info = p.getJointInfo(body, index, client)
            index_of[info[1].decode()] = index
            self._link_index[info[12].decode()] = index
        free_of_losses(p, client, body)
        moving = self.robot.moving_joints
        self.joints = tuple(joint.name for joint in moving)
        self._indices = [index_of[joint.name] for joint in moving]
        self._frictions = [0.0 if self._exact else joint.friction for joint in moving]
        self._companion: Companion | None = None
        stops = [(index, *joint.stops) for index, joint in zip(self._indices, moving, strict=True)]
        self._stops = [] if self._exact or not np.isfinite([ends for _, *ends in stops]).any() else stops
        # erp 0: a stop takes a joint's velocity and does not push it back; see _reach_stops.
        p.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS, solverResidualThreshold=SOLVER_RESIDUAL, erp=0.0, physicsClientId=client
        )

    def prepare(self, step: float, *, staggered: bool) -> None:
        """Before the first step."""
        self._step = step
        self._p.setTimeStep(step, physicsClientId=self._client)
        self._set_friction(1.0)
        lagging = staggered and (len(self.joints) > 1 or not self._scenario.fixed_base)
        self._companion = None
        if self._exact or lagging:
            self._companion = Companion(proxy(self), self._scenario, self.robot, exact=self._exact)
            self._companion.prepare(step, staggered=staggered)
            self._companion.reset()

    def _set_friction(self, fraction: float) -> None:
        """Velocity motors at target 0: with force 0 they free the joint, with a force they are its Coulomb friction.

        Bullet keeps their impulse, so they are issued anew after every change of step.
        """
        for index, friction in zip(self._indices, self._frictions, strict=True):
            self._set_motor(index, friction * fraction)

    def _set_motor(self, index: int, force: float, velocity: float = 0.0) -> None:
        p = self._p
        p.setJointMotorControl2(
            self._body, index, p.VELOCITY_CONTROL, targetVelocity=velocity, force=force, physicsClientId=self._client
        )

    def set_state(self, positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Joints there, moving so; everything else as at the start."""
        self._states = None
        p, client, body = self._p, self._client, self._body
        base, objects = self._start
        p.resetBasePositionAndOrientation(body, *base, physicsClientId=client)
        p.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0], physicsClientId=client)
        for index, position, velocity in zip(self._indices, positions, velocities, strict=True):
            p.resetJointState(body, index, position, velocity, physicsClientId=client)
        self._world.set_states(objects)
        if self._companion is not None:
            self._companion.reset()

    def accelerate(self) -> None:
        """Compile what is the engine's own."""
        if self._companion is not None:
            self._companion.accelerate()

    # -- stepping ---------------------------------------------------------------------------------------------------

    def states(self) -> Any:
        """Bullet's states of the joints, kept for the step that follows."""
        self._states = self._read_states()
        return self._states

    def read(self) -> tuple[list[float], list[float]]:
        """Positions and velocities of the joints."""
        states = self.states()
        return [state[0] for state in states], [state[1] for state in states]

    unpack = staticmethod(_unpack)

    def states_type(self) -> Any:
        """Numba's type of `states`; what need not be taken apart is typed as None."""
        from numba import types

        kinds: Any = types
        joint = kinds.Tuple((kinds.float64, kinds.float64, kinds.none, kinds.none))
        return kinds.UniTuple(joint, len(self.joints))

    def set_friction(self, bounds: Sequence[float]) -> None:
        """Coulomb friction of the joints."""
        if self._exact and self._companion is not None:
            self._companion.set_friction(bounds)
        else:
            self._frictions = list(bounds)
            self._set_friction(1.0)

    def advance(self, forces: Sequence[float], fraction: float = 1.0) -> None:
        """One step under mean torques."""
        if fraction != 1.0:
            self._first(forces, fraction)
            return
        if self._companion is not None:
            forces = self._companion.forces(self._states or self.states(), forces)
        self._advance(forces)

    def _advance(self, forces: Sequence[float]) -> None:
        """One step under torques that the companion has completed."""
        arrived = self._reach_stops() if self._stops else ()
        self._apply(forces=forces)
        self._simulate()
        self._states = None
        for index, friction in arrived:
            self._set_motor(index, friction)

    def _reach_stops(self) -> list[tuple[int, float]]:
        """Let joints that would pass their stops in this step just reach them: Bullet's own stops act on joints beyond only.

        Returns index and friction of these joints, whose motors serve for it.
        """
        p, arrived = self._p, []
        for (index, lower, upper), friction in zip(self._stops, self._frictions, strict=True):
            position, velocity = p.getJointState(self._body, index, self._client)[:2]
            reach = ((upper if velocity > 0.0 else lower) - position) / self._step
            if reach * velocity > 0.0 and abs(velocity) > abs(reach):
                # A hair beyond, where Bullet's stop holds it from the next step on.
                self._set_motor(index, ARREST, reach + (BEYOND if velocity > 0.0 else -BEYOND) / self._step)
                arrived.append((index, friction))
        return arrived

    def _first(self, forces: Sequence[float], fraction: float) -> None:
        """A step whose kick is only a part of one: everything that pushes acts with that part of its impulse."""
        p = self._p
        if self._companion is not None:
            forces = self._companion.first(self.states(), forces, fraction)
        else:
            forces = [fraction * force for force in forces]
        p.setGravity(*(fraction * component for component in self._scenario.gravity), physicsClientId=self._client)
        self._set_friction(fraction)
        self._advance(forces)
        p.setGravity(*self._scenario.gravity, physicsClientId=self._client)
        self._set_friction(1.0)
        if self._companion is not None:
            self._companion.after_first(self.read()[1])

    def push_base(self, force: Array, torque: Array) -> None:
        """Force (3,) N and torque (3,) N m, world axes, on the base's centre of mass in the next step."""
        p, client, body = self._p, self._client, self._body
        centre = p.getBasePositionAndOrientation(body, client)[0]
        p.applyExternalForce(body, -1, force.tolist(), centre, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(body, -1, torque.tolist(), p.WORLD_FRAME, physicsClientId=client)

    def apply_wrench(self, index: int, values: Sequence[float]) -> None:
        """Force and torque of the scenario's wrench `index` for the next step."""
        wrench = self._scenario.wrenches[index]
        if self._companion is not None:
            self._companion.wrench(index, values)
        p, client, body = self._p, self._client, self._body
        (position, rotation), force, torque = self.model.frame_now(wrench.link), np.array(values[:3]), np.array(values[3:])
        if wrench.frame != "world":
            force, torque = rotation @ force, rotation @ torque
        number = self.model.index_of(wrench.link)
        centre = np.array(self.model.inertial_frame(number)[0])
        turn = torque + np.cross(position + rotation @ np.array(wrench.point) - centre, force)
        p.applyExternalForce(body, number, force.tolist(), centre.tolist(), p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(body, number, turn.tolist(), p.WORLD_FRAME, physicsClientId=client)

    def kernel(self) -> EngineKernel | None:
        """What completes the torques; steps go through PyBullet's Python functions."""
        return None if self._companion is None else self._companion.kernel(self._advance)

    def vary(self, robot: Robot) -> bool:
        """True where only damping and motors differ, or friction that the companion has: changed bodies differ from loaded."""
        before, after = ([joint.frictions for joint in one.moving_joints] for one in (self.robot, robot))
        if robot.links != self.robot.links or before == after:
            return robot.links == self.robot.links
        if not (self._exact and any(map(any, after)) and self._companion and self._companion.vary(robot)):
            return False
        self.robot = robot
        return True

    def snapshot(self) -> Any:
        """The engine's whole state."""
        state = self._p.saveState(physicsClientId=self._client)
        return SavedState(self._p, self._client, state, self._alive), self._companion and self._companion.snapshot()

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        saved, companion = state
        self._states = None
        self._p.restoreState(saved.number, physicsClientId=self._client)
        if self._companion is not None:
            self._companion.restore(companion)

    # -- what is around ---------------------------------------------------------------------------------------------

    def base_state(self) -> tuple[Array, Array, Array]:
        """Of a floating base: centre of mass (3,) m, rotation (3, 3) of its frame; velocity of the centre and angular velocity
        in the base's axes, (6,)."""
        _, rotation = self.model.frame_now(self.base)
        linear, angular = self._p.getBaseVelocity(self._body, self._client)
        centre = self._p.getBasePositionAndOrientation(self._body, self._client)[0]
        return np.array(centre), rotation, np.concatenate([linear, rotation.T @ np.array(angular)])

    def mechanical_energy(self) -> float | None:
        """Kinetic and gravitational energy of the robot's links in J; None with contacts or a free base."""
        if not self._scenario.fixed_base or not self._scenario.world.empty:
            return None
        return self.model.mechanical_energy()

    def bodies(self) -> Mapping[str, tuple[float, ...]]:
        """Poses of the world's objects, and of the base link if it floats."""
        base = {} if self._scenario.fixed_base else {self.base: self.model.base_pose()}
        return base | self._world.poses()

    def contacts(self) -> Mapping[str, tuple[float, float, float]]:
        """Contact forces on the world's objects and on the robot by the ground."""
        return self._world.contacts()

    def close(self) -> None:
        """Disconnect the physics client."""
        self._release()


def make_bullet(scenario: Scenario, robot: Robot) -> tuple[BulletEngine, tuple[Problem, ...]]:
    """The scenario's world in PyBullet, and warnings of what the engine does not take. Raises RobotError, SimulationError."""
    engine = BulletEngine(scenario, robot)
    return engine, (*engine.warnings, *overlaps())
