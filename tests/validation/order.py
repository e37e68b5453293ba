"""Order of convergence, shown for everything that may spoil it, against the independent solution of :mod:`.planar`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from asrsim.actuators import MODES
from asrsim.samples import Array
from asrsim.signals import Signal, Sinusoid, Step
from validation.check import Check
from validation.conservation import motors
from validation.fitting import orders
from validation.models import GRAVITY, Body, chain, run
from validation.planar import Input, solve

LINK = Body(mass=0.5, reach=0.08, inertia=6e-4, length=0.1)
SMOOTH_MOTOR = {"motor_1_friction_torque": 0.0, "motor_1_max_velocity": math.inf, "motor_1_max_torque": 1e3}
SOFT = {"spring_stiffness": 20.0}
FASTEST = 1e-3
"""s, the coarsest step of a case."""
OFF_GRID = 0.3 + FASTEST / 3.0
"""s: a third of a step past a step, at the coarsest step and at a quarter of it alike."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A motion whose error is looked at for several steps."""

    name: str
    bodies: Sequence[Body]
    mode: int | None = None
    references: Mapping[str, Any] = field(default_factory=dict)
    external: Signal | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    initial: Sequence[float] = ()
    duration: float = 0.6
    """s."""
    jumps: tuple[float, ...] = ()
    error: float = 1e-3
    """rad that the coarsest step must stay below."""
    order: float = 1.8
    """Order that must be reached."""
    finer: float = 4.0
    """Between which steps: more where the error at the coarsest is not yet the asymptotic one."""


def errors(case: Case, steps: Sequence[float], *, stepping: str = "leapfrog") -> list[float]:
    """Largest error in rad of all joints, at each of `steps` in s, which divide the first; one world step a step."""
    truth: Array | None = None
    found = []
    for step in steps:
        result = run(
            chain(*case.bodies), mode=case.mode, references=case.references, parameters=case.parameters, initial=case.initial,
            external={f"joint_{j + 1}": case.external for j in range(len(case.bodies))} if case.external else {},
            duration=case.duration, step=step, substeps=1, motor_substeps=1, stepping=stepping,
        )  # fmt: skip
        if truth is None:
            names = MODES[case.mode].references if case.mode is not None else ()
            signals = [as_function(case.references.get(name, 0.0)) for name in (*names, "", "")[:2]]
            inputs = (signals[0], signals[1], as_function(case.external or 0.0))
            truth = solve(
                result, case.bodies, gravity=GRAVITY, inputs=[inputs] * len(case.bodies), jumps=case.jumps, step=steps[0]
            )
        if result.samples is None:
            raise ValueError("the run kept no samples")
        positions = result.samples.values["link_position"][:: round(steps[0] / step)]
        found.append(float(np.max(np.abs(positions - truth))))
    return found


def as_function(signal: Any) -> Input:
    """A signal or number as a function of one time."""
    if isinstance(signal, Signal):
        return lambda t: float(signal.values(np.array([t]))[0])
    return lambda t: float(signal)


def smooth_cases() -> Iterator[Case]:
    """Where forces are smooth: many joints with Coriolis torques, motors, damping, adjusters."""
    passive, lossy = replace(LINK), replace(LINK, damping=0.02)
    yield Case(name="double pendulum, free", bodies=[passive] * 2, initial=[1.5, 0.5], error=1e-3)
    yield Case(name="triple pendulum, free", bodies=[passive] * 3, initial=[1.5, 0.5, -1.0], error=4e-3)
    yield Case(name="triple pendulum, damped", bodies=[lossy] * 3, initial=[1.5, 0.5, -1.0], finer=16.0)
    yield Case(
        name="3 joints, mode 0, torques", bodies=[replace(LINK, actuator="sea", damping=0.01)] * 3, mode=0,
        references={"link_torque": Sinusoid(amplitude=0.4, frequency=2.0)}, error=3e-3,
    )  # fmt: skip
    yield Case(
        name="2 joints, mode 1, PID on the link", bodies=[replace(LINK, actuator="sea")] * 2, mode=1,
        references={"link_position": Sinusoid(amplitude=0.4, frequency=2.0)},
    )  # fmt: skip
    yield Case(
        name="2 joints, mode 3, SEA swinging fast", bodies=[replace(LINK, actuator="sea")] * 2, mode=3, initial=[-0.3, 0.4],
        references={"equilibrium_position": 0.5}, parameters=SOFT, error=3e-2,
    )  # fmt: skip
    yield Case(
        name="3 joints, mode 3, SEA swinging fast, damped", bodies=[replace(LINK, actuator="sea", damping=0.02)] * 3, mode=3,
        initial=[-0.1, 0.1, 0.1], references={"equilibrium_position": 0.5}, parameters=SOFT, error=2e-3,
    )  # fmt: skip
    yield Case(
        name="3 joints, mode 3, qbMove", bodies=[replace(LINK, actuator="qbmove", damping=0.02)] * 3, mode=3,
        references={"equilibrium_position": Sinusoid(amplitude=0.4, frequency=2.0), "stiffness_preset": 0.5},
    )  # fmt: skip
    for actuator, preset in ACTUATED.items():
        bodies = [replace(LINK, actuator=actuator, damping=0.02)] * 2
        second = _second(actuator)
        parameters = motors(actuator, SMOOTH_MOTOR) | (SOFT if actuator == "sea" else {})
        yield Case(
            name=f"2 joints, mode 4, {actuator}", bodies=bodies, mode=4, parameters=parameters, error=2e-5,
            references={"motor_1_torque": Sinusoid(amplitude=0.6, frequency=3.0), "motor_2_torque": second},
        )  # fmt: skip
        yield Case(
            name=f"2 joints, mode 6, {actuator}", bodies=bodies, mode=6, parameters=parameters,
            references={"equilibrium_position": Sinusoid(amplitude=0.4, frequency=2.0), "stiffness_preset": preset},
        )  # fmt: skip
        yield Case(
            name=f"2 joints, mode 5 with integral action, {actuator}", bodies=bodies, mode=5,
            parameters=parameters | motors(actuator, {"controller_1_integral": 300.0}),
            references={
                "reference_1": Sinusoid(amplitude=0.4, frequency=2.0),
                "reference_2": second if actuator == "awas_ii" else Sinusoid(amplitude=0.3, frequency=3.0),
            },
        )  # fmt: skip


ACTUATED = {"sea": 0.0, "qbmove": 0.4, "bavs": 0.1, "awas_ii": 0.01}


def _second(actuator: str) -> Any:
    return Sinusoid(amplitude=0.002, frequency=3.0, offset=0.01) if actuator == "awas_ii" else -0.05


def jump_cases() -> Iterator[Case]:
    """Inputs that jump in mid-run, on a step and a third of a step after one."""
    for actuator, preset in ACTUATED.items():
        bodies = [replace(LINK, actuator=actuator, damping=0.02)] * 2
        smooth = motors(actuator, SMOOTH_MOTOR)
        spring = SOFT if actuator == "sea" else {}
        for label, at in (("on the grid", 0.3), ("off the grid", OFF_GRID)):
            step = Step(at=at, before=0.1, after=0.4)
            mapped = {"equilibrium_position": step, "stiffness_preset": preset}
            torque = {"motor_1_torque": step, "motor_2_torque": preset if actuator == "awas_ii" else 0.0}
            for mode, references, parameters in ((3, mapped, {}), (4, torque, smooth), (6, mapped, smooth)):
                yield Case(
                    name=f"2 joints, mode {mode}, {actuator}, jump {label}", bodies=bodies, mode=mode, jumps=(at,),
                    references=references, parameters={**parameters, **spring},
                )  # fmt: skip
    for label, at in (("on the grid", 0.3), ("off the grid", OFF_GRID)):
        yield Case(
            name=f"2 joints, mode 3, external torque jumps {label}", bodies=[replace(LINK, actuator="sea", damping=0.02)] * 2,
            mode=3, references={"equilibrium_position": 0.0}, external=Step(at=at, after=0.3), jumps=(at,), parameters=SOFT,
        )  # fmt: skip


def _checks(cases: Iterator[Case]) -> Iterator[Check]:
    for case in cases:
        coarse, fine = errors(case, (FASTEST, FASTEST / case.finer))
        yield Check(name=f"error at 1 ms, {case.name}", figure=coarse, bound=case.error, unit="rad", source="DOP853")
        yield Check(
            name=f"order, {case.name}",
            figure=orders([coarse, fine], case.finer)[0],
            bound=case.order,
            at_least=True,
            source="2",
        )


def smooth() -> Iterator[Check]:
    """Second order where forces are smooth."""
    yield from _checks(smooth_cases())


def jumps() -> Iterator[Check]:
    """Second order across jumps of inputs."""
    yield from _checks(jump_cases())


def first_order_schemes() -> Iterator[Check]:
    """What the other schemes do with the same motion: first order, and the error beside the default's."""
    case = next(case for case in smooth_cases() if case.name == "2 joints, mode 6, qbmove")
    best = errors(case, (FASTEST, FASTEST / 4.0))
    for stepping in ("euler", "toolbox"):
        coarse, fine = errors(case, (FASTEST, FASTEST / 4.0), stepping=stepping)
        name = f"{stepping}, {case.name}"
        yield Check(name=f"order, {name}", figure=orders([coarse, fine], 4.0)[0], bound=0.8, at_least=True, source="1")
        yield Check(
            name=f"error over the default's, {name}", figure=coarse / best[0], bound=10.0, at_least=True, source="DOP853"
        )


def friction_orders() -> Iterator[Check]:
    """Dry friction switches: of joints (the engine's) and of motors (Dahl's), against a run with steps 512 times finer."""
    sticky = Body(actuator="sea", mass=0.4, reach=0.05, inertia=2e-3, friction=0.02)
    wave = Sinusoid(amplitude=0.4, frequency=1.5)
    cases = (
        ("Coulomb friction of the joint, mode 3", sticky, 3, {"equilibrium_position": wave}, SOFT),
        ("Dahl friction of the motors, mode 6", replace(sticky, friction=0.0), 6, {"equilibrium_position": wave}, SOFT),
        ("both, mode 6", sticky, 6, {"equilibrium_position": wave}, SOFT),
    )
    steps = [1e-3 / 2.0**i for i in range(6)]
    for name, body, mode, references, parameters in cases:
        positions = []
        for step in (*steps, steps[-1] / 16.0):
            result = run(
                chain(body), mode=mode, references=references, parameters=parameters, duration=0.6, step=step,
                substeps=1, motor_substeps=1,
            )  # fmt: skip
            if result.samples is not None:
                positions.append(result.samples.values["link_position"][:: round(steps[0] / step), 0])
        found = [float(np.max(np.abs(q - positions[-1]))) for q in positions[:-1]]
        # Where a turning point falls between steps is chance: the order shows over several halvings only.
        slope = float(np.polyfit(np.log(steps), np.log(found), 1)[0])
        yield Check(name=f"error at 1 ms, {name}", figure=found[0], bound=1e-3, unit="rad", source="the same at 1/512 ms")
        yield Check(name=f"order over five halvings, {name}", figure=slope, bound=0.75, at_least=True, source="1")
