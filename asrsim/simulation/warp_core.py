"""State of N simulated worlds on Warp: asrsim's kernel, translated, loads the links that MuJoCo Warp moves."""

from __future__ import annotations

import copy
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.engines.base import Engine
from asrsim.engines.mujoco import MujocoEngine
from asrsim.engines.mujoco_build import HARD
from asrsim.engines.mujoco_library import load
from asrsim.errors import InputError, SimulationError
from asrsim.records import numbers
from asrsim.samples import Array
from asrsim.simulation.core import UNOBSERVED, Core
from asrsim.simulation.fields import JOINT, motor_column, row_of_joint
from asrsim.simulation.inputs import Given
from asrsim.simulation.kernel import FASTEST
from asrsim.simulation.layout import HEALTH
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import RowColumns
from asrsim.simulation.rows import constants_table, kinds_of, scheme_of, start_of, table_of_kinds
from asrsim.simulation.shape import shape_of
from asrsim.simulation.warp_step import LOADS, law_of, program
from asrsim.warping.program import loaded_warp

INERTIALS = ("body_mass", "body_subtreemass", "body_inertia", "body_ipos", "body_iquat", "body_invweight0", "dof_invweight0")
"""Fields of a model that follow from the inertials of the links."""
NO_STOP = 1e6
"""Position that stands for a missing stop, rad or m."""


class WarpCore(Core):
    """N worlds of one robot on a device of Warp, in single precision. All worlds share a model; inertials differ by world."""

    def __init__(self, prepared: Prepared, engine: Engine, *, worlds: int, device: str) -> None:
        """engine: engine of the prepared scenario; device: name of a device of Warp, such as `cpu` or `cuda`. Raises
        SimulationError, and InputError for scenarios that cannot run on Warp.
        """
        wp = self._wp = loaded_warp()
        self._mjw: Any = import_module("mujoco_warp")
        if not isinstance(engine, MujocoEngine):
            raise InputError(
                "Warp can only simulate robots with the engine 'mujoco'", key="engine", hint="engine: mujoco", code="warp"
            )
        _check(prepared)
        try:
            self._device = wp.get_device(device)
        except Exception as error:
            names = tuple(str(one) for one in wp.get_devices())
            raise InputError(f"Warp has no device '{device}'", key="device", choices=names, code="warp-device") from error
        self.prepared, self.compiled, self._engine = prepared, True, engine
        self.shape = shape_of(prepared.drives)
        self._scheme = scheme_of(prepared)
        made, laws = program(prepared.drives, self.shape)
        self._program: Any = made.load()
        constants = constants_table(prepared, self.shape)
        joints = kinds_of(prepared.drives, self.shape)
        for k, drive, stages in zip(joints, prepared.drives, self.shape.stages, strict=True):
            law = law_of(drive, stages)
            k.spring_law = 0 if law is None else laws.index(law) + 1
        kinds = table_of_kinds(joints, self.shape)
        self._joint_states = np.zeros((worlds, len(kinds), self.shape.state), dtype=np.float32)
        self._advanced = set()
        self.P = np.repeat(constants[None].astype(np.float32), worlds, axis=0)
        self.held = np.full((worlds, len(kinds), self.shape.goals), np.nan)
        self.done = np.zeros(worlds, dtype=np.int64)
        self.strides = np.zeros((worlds, 3), dtype=np.int64)
        self.fault = np.zeros((worlds, 2), dtype=np.int64)
        self.corrections = UNOBSERVED
        self._start_engine(engine, prepared)
        self._make_model(worlds)
        new = self._new
        self._s, self._p, self._k, self._z = new(self.joint_states), new(self.P), new(kinds, int), new(numbers(self._scheme))
        self._kinds = kinds
        self._which = new(np.zeros((worlds, 3)), int, flat=False)
        self._done, self._ran, self._sizes = new(self.done, int), new(self.done, int), new(np.zeros(8), int)
        self._loads = new(np.zeros((worlds, len(kinds), LOADS)))
        self._changed = True
        """Whether state or parameters have changed in the host's memory since they were copied to the device."""
        self._given: Given | None = None
        """Inputs that were last copied to the device."""
        self._graph: Any = None
        self._rows: Any = None
        self._loaded = False
        """Whether a substep has loaded all kernels, as the recording of a graph requires."""

    def _new(self, values: Any, kind: Any = float, *, flat: bool = True) -> Any:
        """An array on the device with these values."""
        numbers = np.ascontiguousarray(values, dtype=np.int32 if kind is int else np.float32)
        return self._wp.array(numbers.ravel() if flat else numbers, dtype=kind, device=self._device)

    def _make_model(self, worlds: int) -> None:
        """Make the model of the links, with separate inertials, loads and states for each world."""
        engine, wp = self._engine, self._wp
        room = engine.room
        model = self._model = copy.copy(engine.raw_model)
        freedoms, joints = room.joint_v, engine.raw_model.dof_jntid[room.joint_v]
        step = self._scheme.step
        model.opt.timestep = step
        if self.prepared.scenario.world.empty:
            # Use simple friction cones, with which the solver is faster. Elliptic cones are only needed for contacts.
            model.opt.cone, model.opt.impratio = load().mjtCone.mjCONE_PYRAMIDAL, 1.0
        # Clear MuJoCo's flag that forbids automatic resets: MuJoCo Warp does not support this flag. It never resets a world
        # automatically.
        model.opt.disableflags &= ~int(load().mjtDisableBit.mjDSBL_AUTORESET)
        model.dof_solimp[freedoms] = HARD
        model.dof_solref[freedoms] = (-1.0, -HARD[0] / step)
        limited = np.isfinite(room.lower) | np.isfinite(room.upper)
        model.jnt_limited[joints] = limited
        stops = np.column_stack([np.maximum(room.lower, -NO_STOP), np.minimum(room.upper, NO_STOP)])
        model.jnt_range[joints], model.jnt_solimp[joints] = stops, HARD
        model.jnt_solref[joints] = (-1.0 / step**2, -1.0 / step)
        with wp.ScopedDevice(self._device):
            m = self._m = self._mjw.put_model(model)
            self._d = self._mjw.make_data(model, nworld=worlds)
            for name in (*INERTIALS, "dof_armature", "dof_frictionloss", "jnt_range", "jnt_solref"):
                one = getattr(m, name)
                setattr(m, name, wp.array(np.repeat(one.numpy(), worlds, axis=0), dtype=one.dtype, device=self._device))
        self._inertials = {name: getattr(m, name).numpy().copy() for name in INERTIALS}
        self._stops = self._new(np.column_stack([stops, joints, np.full(len(joints), step)]))
        self._freedoms, self._coordinates = self._new(room.joint_v, int), self._new(room.joint_q, int)
        self._places = {name: self._engine_array(name) for name in ("qpos", "qvel", "qacc_warmstart")}

    def _engine_array(self, name: str) -> NDArray[np.float32]:
        return np.array(getattr(self._d, name).numpy())

    def record(self, columns: RowColumns, *, watched: bool) -> None:
        """Set what is recorded at whole steps."""
        self.columns, self._watched = columns, 0
        self.rows = np.full((*self.joint_states.shape[:2], len(columns.place)), np.nan)
        self._columns = self._new(columns.of_state, int)

    @property
    def native(self) -> bool:
        """Whether the whole loop is machine code that threads can share."""
        return False

    def close(self) -> None:
        """Close the engine."""
        self._engine.close()

    # -- state ------------------------------------------------------------------------------------------------------

    def take_over(self, world: int, prepared: Prepared) -> None:
        """Give a world other parameters. The world must then be started again."""
        rows = zip(prepared.drives, self.shape.stages, strict=True)
        new = [stage.name for drive, own in rows for stage in drive.stages if stage not in own]
        if new:
            raise SimulationError(
                f"on Warp, a world cannot switch on the stage '{new[0]}', which is off in the scenario: set its parameters in "
                "the scenario"
            )
        self.P[world] = constants_table(prepared, self.shape)
        if prepared.robot.links != self._engine.robot.links and not self._engine.vary(prepared.robot):
            raise SimulationError(
                "on Warp, masses cannot vary in a world with contacts, or if they move the centre of mass of a floating base"
            )
        for name, table in self._inertials.items():
            values = np.asarray(getattr(self._engine.raw_model, name))
            table[world] = values.reshape(table[world].shape)
        self._changed = True

    def start(self, world: int, prepared: Prepared) -> None:
        """Set a world to the initial state of a run."""
        placed = self._start_engine(self._engine, prepared)
        rows = zip(prepared.drives, *placed, strict=True)
        self.joint_states[world] = [row_of_joint(start_of(drive, self.shape, q, v)) for drive, q, v in rows]
        self.held[world] = self.rows[world] = np.nan
        self.done[world], self.fault[world] = 0, HEALTH.healthy
        state, first = self._engine.state, self._model.nq
        self._places["qpos"][world], self._places["qvel"][world] = state[:first], state[first : first + self._model.nv]
        self._places["qacc_warmstart"][world] = 0.0
        self._changed = True

    def state(self, world: int) -> tuple[Any, ...]:
        """A copy of the complete state of a world."""
        rows = {name: table[world].copy() for name, table in (*self._places.items(), *self._inertials.items())}
        return *(table[world].copy() for table in self._tables), rows

    def put(self, world: int, prepared: Prepared, state: tuple[Any, ...]) -> None:
        """Set the complete state of a world, and the parameters of this state."""
        *values, rows = state
        for table, row in zip(self._tables, values, strict=True):
            table[world] = row
        for name, table in (*self._places.items(), *self._inertials.items()):
            table[world] = rows[name]
        self._changed = True

    def engine_of(self, world: int) -> Engine:
        """The engine that `look` sets to the state of a world. It does not move the worlds."""
        return self._engine

    def look(self, world: int) -> Engine:
        """The engine, set to the state of a world."""
        prepared = self.prepared
        self._start_engine(self._engine, prepared)
        state, first, size = self._engine.state, self._model.nq, self._model.nv
        state[:first] = self._places["qpos"][world]
        state[first : first + size] = state[first + size : first + 2 * size] = self._places["qvel"][world]
        self._engine.state = state
        return self._engine

    # -- running ----------------------------------------------------------------------------------------------------

    def taken(self, given: Given) -> Given:
        """Inputs in the form that `run` takes."""
        return given

    def run(self, which: NDArray[np.int64], given: Given, first: int, count: int, out: Array) -> None:
        """Advance worlds by `count` substeps; see `Core.run`. The other worlds move too, and are then reset to their previous
        states.
        """
        worlds, every = which[:, 0], self.prepared.resolution.substeps
        tables: dict[str, NDArray[Any]] = {"S": self.joint_states, **self._places}
        others = np.setdiff1d(np.arange(len(self.joint_states)), worlds)
        kept = {name: table[others].copy() for name, table in tables.items()}
        self._send(which, given, first, every)
        rows = self._rows_of(-(-count // every))
        for _ in range(count):
            self._substep(rows)
        self._s_to_host()
        for name, table in tables.items():
            table[others] = kept[name]
        self._changed = self._changed or len(others) > 0
        done, last = self.done[worlds], self.done[worlds] + count
        begin, end = -(-done // every), -(-last // every)
        found, state = rows.numpy(), len(self.columns.of_state)
        for place, (world, own, *_) in enumerate(which.tolist()):
            number = int(end[place] - begin[place])
            if number:
                out[place, :number, :, :state] = found[:number, world]
                steps = first + (begin[place] + np.arange(number)) * every - done[place]
                out[place, :number, :, state:] = given.references[own][steps][..., self.columns.of_inputs]
                self.rows[world] = out[place, number - 1]
        self.done[worlds] = last
        self._look_for_faults(worlds)

    def _look_for_faults(self, worlds: NDArray[np.int64]) -> None:
        speeds, places = (
            self.joint_states[worlds][..., JOINT["engine_velocity"]],
            self.joint_states[worlds][..., JOINT["position"]],
        )
        wrong = ~(np.abs(speeds) <= FASTEST) | ~np.isfinite(places)
        for place in np.flatnonzero(wrong.any(axis=1)).tolist():
            joint = int(wrong[place].argmax())
            self.fault[worlds[place]] = (HEALTH.ran_away if np.isfinite(speeds[place, joint]) else HEALTH.no_value), joint

    def _rows_of(self, count: int) -> Any:
        """Array on the device for `count` recorded rows."""
        shape = max(count, 1), *self.joint_states.shape[:2], max(len(self.columns.of_state), 1)
        if self._rows is None or self._rows.shape != shape:
            self._rows, self._graph = self._wp.zeros(shape, dtype=float, device=self._device), None
        return self._rows

    def device_arrays(self) -> dict[str, Any]:
        """Arrays of Warp that share the memory of the state on the device; see `asrsim.Worlds.device_arrays`."""
        self._upload()
        worlds, joints, size = self.joint_states.shape
        kind = self._s.dtype
        columns = {"link_position": JOINT["position"], "link_velocity": JOINT["engine_velocity"]}
        for i in range(self.shape.motors):
            columns[f"motor_{i + 1}_velocity"] = motor_column("velocity", i)
        found = {
            name: self._wp.array(
                ptr=self._s.ptr + 4 * column,
                dtype=kind,
                shape=(worlds, joints),
                strides=(4 * joints * size, 4 * size),
                device=self._device,
            )
            for name, column in columns.items()
        }
        for one in found.values():
            # Let each array refer to the state, so that the memory that they share stays alive.
            one.state = self._s
        return found

    def _upload(self) -> None:
        """Copy state and parameters to the device, if they have changed in the host's memory."""
        if self._changed:
            self._s.assign(self.joint_states.ravel())
            self._p.assign(self.P.ravel())
            for name, table in self._places.items():
                getattr(self._d, name).assign(table)
            for name, table in self._inertials.items():
                getattr(self._m, name).assign(table)
            self._changed = False

    def _send(self, which: NDArray[np.int64], given: Given, first: int, every: int) -> None:
        """Copy changed tables to the device."""
        self._upload()
        if given is not self._given:
            cuts = given.cuts
            count = given.inputs.shape[1]
            pieces = np.empty((len(cuts), count, 3), dtype=np.int32)
            pieces[:] = np.column_stack([np.arange(count), np.arange(1, count + 1), np.full(count, -1)])
            for timing, table in enumerate(cuts):
                for row, begin, end, on_time in table[table[:, 0] >= 0].tolist():
                    pieces[timing, row] = begin, end, on_time
            new = self._new
            self._inputs, self._lengths, self._pieces = new(given.inputs), new(given.lengths), new(pieces, int)
            self._given, self._graph = given, None
        _, rows, joints, columns = given.inputs.shape
        sizes = joints, rows, columns, first, self.joint_states.shape[2], self.P.shape[2], self._kinds.shape[1], every
        self._sizes.assign(np.array(sizes, dtype=np.int32))
        table = np.zeros((len(self.joint_states), 3), dtype=np.int32)
        table[which[:, 0]] = which[:, [0, 1, 3]]
        self._which.assign(table)
        self._done.assign(self.done.astype(np.int32))
        self._ran.zero_()

    def _substep(self, rows: Any) -> None:
        """Advance all worlds by a substep. A GPU runs the recorded launches as one graph."""
        if not (self._device.is_cuda and self._loaded):
            self._launch(rows)
            self._loaded = True
            return
        if self._graph is None:
            with self._wp.ScopedCapture(device=self._device) as capture:
                self._launch(rows)
            self._graph = capture.graph
        self._wp.capture_launch(self._graph)

    def _launch(self, rows: Any) -> None:
        wp, code, d, m, size = self._wp, self._program, self._d, self._m, self.joint_states.shape[:2]
        wp.launch(
            code.load_joints, dim=size, device=self._device,
            inputs=[
                self._s, self._p, self._k, self._z, self._sizes, self._inputs, self._lengths, self._pieces, self._which,
                self._done, self._ran, self._freedoms, self._loads, d.qfrc_applied, m.dof_armature, m.dof_frictionloss,
                self._coordinates, self._stops, d.qpos, d.qvel, m.jnt_range, m.jnt_solref,
            ],
        )  # fmt: skip
        with wp.ScopedDevice(self._device):
            self._mjw.step(m, d)
        wp.launch(
            code.settle_joints, dim=size, device=self._device,
            inputs=[
                self._s, self._p, self._k, self._z, self._sizes, self._pieces, self._which, self._done, self._ran,
                self._freedoms, self._coordinates, self._loads, d.qpos, d.qvel, self._columns, rows,
            ],
        )  # fmt: skip
        wp.launch(code.count_steps, dim=size[0], inputs=[self._ran], device=self._device)

    def _s_to_host(self) -> None:
        """Copy the states from the device."""
        self.joint_states[:] = self._s.numpy().reshape(self.joint_states.shape)
        for name, table in self._places.items():
            table[:] = getattr(self._d, name).numpy()


def _check(prepared: Prepared) -> None:
    """Raise InputError for a scenario that Warp cannot run."""
    if prepared.stepping.released:
        message = f"the stepping '{prepared.stepping.name}' advances joints by a function that has no translation to Warp"
        raise InputError(message, key="stepping", hint="stepping: leapfrog", code="warp")
    if any(joint.mimic or joint.armature for joint in prepared.robot.moving_joints):
        raise InputError("Warp cannot simulate coupled joints and rotors yet", key="engine", code="warp")
    if prepared.robot.loops:
        raise InputError("Warp cannot simulate closed chains yet", key="engine", code="warp")
    if any(link.weightless[0] for link in prepared.robot.links):
        raise InputError("Warp cannot simulate links without gravity yet", key="engine", code="warp")
    if prepared.scenario.wrenches:
        raise InputError("Warp cannot simulate external forces on links", key="wrenches", code="warp")
