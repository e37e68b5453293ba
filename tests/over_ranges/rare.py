"""What no fast run comes to: laws that overflow, robots without limits, sweeps with failures, bars that nobody watches, joints
that fall, and compiled code's own functions in plain Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from over_ranges import NOISE, Asked, found

EXAMPLES = Path(__file__).parents[2] / "examples"
Fake = SimpleNamespace


def of_the_rare() -> Asked:
    yield from _roots()
    yield from _references()
    yield from _balances()
    yield from _compiled()
    yield from _words()
    yield from _inertias()
    yield "views", found("render.camera.viewpoint"), [(None,), *((np.array(a),) for a in AXES)]
    yield (
        "farewells",
        lambda number: _pieces(found("live.departed.farewell")(bytes(range(number, number + 12))).hex()),
        [(0,), (40,)],
    )
    yield "rehearsals", _rehearsed, [(gain, bias) for gain in (0.2, 1.0, 1.9, 2.5) for bias in (0.0, 0.5)]


AXES = (
    (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 0.6, 0.8), (0.0, 0.59, 0.81), (0.0, 0.61, -0.79), (0.0, 1.0, 0.0),
    (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.6, 0.5, 0.2), (-0.6, 0.5, 0.2), (0.6, -0.5, -0.2),
)  # fmt: skip


def _pieces(text: str) -> list[str]:
    """A record shows the beginning of a text: of each of these all."""
    return [text[k : k + 48] for k in range(0, len(text), 48)]


def _roots() -> Asked:
    root = found("actuators.rest.increasing_root")

    def cliff(at: float) -> Callable[[float], float]:
        return lambda x: math.inf if x > at else -math.inf if x < at - 0.5 else x - at + 0.2

    laws = (cliff(1.0), cliff(-40.0), lambda x: 2.0 * x - 3.0, lambda x: math.atan(x) - 1.5, lambda x: 1.0)
    yield "cliffs", root, [(law, start, reach) for law in laws for start in (-3.0, 0.0, 5.0) for reach in (0.0, 1.0, 20.0)]
    yield "near", root, [(laws[2], 0.0, reach, most) for reach in (0.4, 0.5, 0.8) for most in (0.1, 1.0, 2.0)]


def _references() -> Asked:
    """Ranges of what may be set from outside, of every actuator and mode."""
    ranges, modes, actuators = found("simulation.ranges._of"), found("actuators.MODES"), found("actuators.ACTUATORS")
    for name in actuators.names():
        actuator = actuators.get(name)
        values = {one.name: one.default for one in actuator.all_parameters()}
        for joint in (Fake(lower=-0.7, upper=0.9, most_effort=4.0), Fake(lower=None, upper=None, most_effort=math.inf)):
            for subscribed, declared in ((False, {}), (True, {}), (True, {"*": {"external_torque": (-1.0, 2.0)}})):
                block, scenario = Fake(subscribe_external_torque=subscribed), Fake(reference_ranges=declared)

                def ask(mode: Any, more: Any, j: Any = joint, b: Any = block, s: Any = scenario) -> Any:
                    drive = Fake(name="j", mode=mode, actuator=actuator, values=values | more, joint=j, block=b)  # noqa: B023
                    return ranges(drive, s)

                narrow = {"motor_1_min_position": -0.3, "motor_1_max_position": 0.2, "motor_1_max_torque": 0.7}
                yield f"ranges {name}", ask, [(mode, more) for mode in modes.values() for more in ({}, narrow)]


def _balances() -> Asked:
    """Regressions of torques that are linear in some numbers only."""
    names = ("a", "b", "c")
    matrix, wanted = NOISE[:36].reshape(12, 3), np.array([0.4, 2.0, 0.05])

    def entry(number: int) -> Any:
        parameter = Fake(size=0.3, low=0.0, logarithmic=False, key=names[number])
        return Fake(parameter=parameter, place=math.log, start=1.0)

    def layout(count: int) -> Any:
        return Fake(entries=[entry(i) for i in range(count)], values=np.exp)

    def left(x: np.ndarray, bend: float) -> np.ndarray:
        there = np.exp(x)
        return matrix[:, : len(x)] @ (there - wanted[: len(x)]) + bend * there[0] ** 2

    solved, near = found("identification.regression._solved"), found("identification.regression._near")
    for bend in (0.0, 0.01, 1.0):
        asked = [(np.log(np.array(start)),) for start in ((1.0, 1.0, 1.0), (0.1, 9.0, 3.0), (1.0,), (0.4, 2.0, 0.05))]
        yield f"solved {bend}", lambda x, b=bend: solved(lambda y: left(y, b), x, layout(len(x))), asked
        yield f"near {bend}", lambda x, b=bend: near(lambda y: left(y, b), x, x - 3.0, x + 3.0), asked


def _compiled() -> Asked:
    """Functions that are compiled, run in plain Python."""
    memory = found("simulation.memory.LOADS")
    yield "loads", lambda n: list(memory[n](list(range(40)))), [(n,) for n in memory]
    reader = found("simulation.memory.make_reader")
    nested = (((1.0,), 2.0), (3.0, ((4.0,), 5.0)), ((6.0,), (7.0, 8.0)))
    yield "readers", lambda c, at: [str(reader(c, at)[1])], [(c, at) for c in nested for at in (0, 7)]

    def stretch(first: int, last: int, friction: bool) -> list[str]:
        """What a stretch does, in its order."""
        told: list[str] = []
        plain = found("simulation.stretch.stretch")
        bound, force = found("simulation.substep.BOUND"), found("simulation.substep.FORCE")
        joints = [[100.0 * j + k for k in range(max(bound, force) + 1)] for j in range(2)]
        world = Fake(forces=[0.0, 0.0], friction=[0.0, 0.0], wrench=[[0.0] * 6], positions=[1, 2], velocities=[3, 4])

        def note(word: str) -> Callable[..., None]:
            return lambda *given: told.append(f"{word} {given[0] if word == 'laws' else ''} {world.forces} {world.wrench}")

        names = {
            "borrow": lambda parts: parts, "look": note("look"), "laws": note("laws"), "move": note("move"),
            "give": found(f"simulation.stretch.{'give_friction' if friction else 'give_forces'}"),
        }  # fmt: skip
        copy = FunctionType(plain.__code__, {**plain.__globals__, **names})
        copy(first, last, joints, None, None, np.arange(60.0).reshape(10, 1, 6).tolist(), world)
        return _pieces(" ".join([*told[:5], f"{world.friction}"]))

    yield "stretches", stretch, [(a, b, f) for a, b in ((0, 0), (2, 4)) for f in (False, True)]


class _Table:
    """A study's, as far as its summary asks."""

    def __init__(self, *statuses: str) -> None:
        self.folder, self.missing, self._statuses = Path("study"), 0, statuses
        self.manifest = {"name": "study", "runs": len(statuses) + 1}
        self.results = ("claim.one", "peak", "flat", "none")

    def __len__(self) -> int:
        return len(self._statuses)

    def __getitem__(self, name: str) -> np.ndarray:
        numbers = np.arange(len(self._statuses))
        return (
            np.array(self._statuses)
            if name == "status"
            else numbers + 3
            if name == "run"
            else np.char.add("why", numbers.astype(str))
        )

    def statuses(self) -> dict[str, int]:
        return {name: self._statuses.count(name) for name in dict.fromkeys(self._statuses)}

    def claims(self) -> dict[str, float]:
        return {"peak < 1": 0.512, "rest > 0": 1.0}

    def unit(self, name: str) -> str:
        return {"peak": "rad"}.get(name, "")

    def quantiles(self, name: str) -> Any:
        quantiles = found("sweeps.table.Quantiles")
        numbers = {"peak": (0.12345, 0.2, 0.5, 0.8, 1234.56), "flat": (1.0,) * 5}.get(name)
        names = ("least", "low", "median", "high", "largest")
        return numbers and quantiles(**dict(zip(names, numbers, strict=True)), count=7, least_run=4, largest_run=11)


def _words() -> Asked:
    """Lines for people."""
    tables = [("complete",) * 3, ("complete",), ("complete", "diverged", "failed", "diverged", "crashed"), ()]
    yield "studies", lambda *s: _pieces(" ".join(" ".join(found("sweeps.show.say_summary")(_Table(*s))).split())), tables
    yield "studies told", lambda *s: found("sweeps.show.as_dict")(_Table(*s)), tables
    robot = Fake(
        joint=lambda name: Fake(kind="prismatic" if name == "lift" else "revolute", effort=3.0 if name == "lift" else None)
    )
    states = ({}, {"on_stop": True}, {"falls": True}, {"overloaded": True}, {"limited": True}, {"droop": 0.11}, {"droop": 0.09})
    usual = {"on_stop": False, "falls": False, "overloaded": False, "limited": False, "droop": 0.0, "sag": 0.2, "load": -4.5678}

    def weight(name: str, state: dict[str, Any], proposal: dict[str, Any]) -> list[str]:
        weak = [Fake(joint=name, time=0.25, **(usual | state))]
        return _pieces(f"{found('kinematics.sizing.problems_of_weight')(Fake(weak=weak, proposal=proposal), robot)[0]}")

    given = ({}, {"lift": {"spring_k": 12.0}})
    yield "weight", weight, [(name, state, one) for name in ("lift", "elbow") for state in states for one in given]
    for name, updates in BARS.items():
        yield f"bar {name}", lambda *u, n=name: _bar(n, u), [updates]


BARS: dict[str, tuple[Any, ...]] = {
    "FractionBar": (("drawing", 0.25), ("saving", 1.0)),
    "RunBar": ((0.5,), (1.5,)),
    "FitBar": tuple(
        (Fake(cost=cost, remaining=left, evaluations=7, stage="search"),)
        for cost in (0.123456, math.inf)
        for left in (12.3, math.nan)
    ),
    "SweepBar": ((Fake(done=3, total=9, rate=0.12345, statuses={"complete": 2, "failed": 1}),),),
}


def _bar(name: str, updates: tuple[Any, ...]) -> list[str]:
    """What a bar that somebody watches is told."""
    said: list[str] = []

    class Watched(found(f"cli.progress.{name}")):  # type: ignore[misc]
        def _is_due(self) -> bool:
            return True

        def _open(self, *columns: Any, **options: Any) -> None:
            said.append(f"{[one if isinstance(one, str) else type(one).__name__ for one in columns]}")
            said.append(f"{options}")
            self._bar, self._task = Fake(update=lambda task, **values: said.append(f"{values}")), "task"

    bar = Watched("run", 2.0, show=False) if name == "RunBar" else Watched("run", show=False)
    bar._began = -math.inf
    for update in updates:
        bar.update(*update)
    return _pieces(" ".join(said))


def _inertias() -> Asked:
    """Moments that follow when others change, and changes that no robot knows."""
    robot = found("robot.load_robot")(EXAMPLES / "urdf" / "dof2_horizontal.urdf")
    asked: list[dict[str, dict[str, float]]] = [
        {"link_1": values}
        for values in (
            {"ixx": 1e-6}, {"iyy": 5.0}, {"izz": 0.3, "ixy": 0.1}, {"ixx": 1.0, "iyy": 0.1, "izz": 0.1},
            {"ixz": 0.02, "ixx": 1e-3},
        )
    ]  # fmt: skip
    yield "physical", lambda changes: found("robot.vary.physical")(robot, changes), [(one,) for one in asked]
    unknown = (
        {"link_9": {"mass": 1.0}},
        {"joint_1": {"dampng": 1.0}},
        {"joint_1": {"damping": -1.0}},
        {"link_1": {"mas": 1.0}},
    )
    yield "varied", lambda changes: found("robot.vary.varied_robot")(robot, changes).name, [(one,) for one in unknown]


def _rehearsed(gain: float, bias: float) -> Any:
    """Updates that a model with friction is asked about."""
    law, reference = found("learning.optimal.NormOptimal"), np.linspace(0.0, 1.0, 5)[:, None]
    trial = found("learning.optimal.Trial")
    lifted = Fake(change=lambda error, rho: (error * (1.0 if rho > 0.05 else 2.0), gain * error))
    start = trial(
        number=0, largest=(1.0,), norm=1.0, rms=(1.0,), seconds=0.0, inputs=np.zeros((5, 1)), outputs=np.zeros((5, 1))
    )
    one = law(problem=Fake(reference=reference), lifted=lifted)
    return one._rehearsed(lifted, start, 0.5 * reference, lambda inputs: gain * inputs - bias * np.sign(inputs) * 0.1)
