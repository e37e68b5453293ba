"""Units of a study's columns: of the robot's numbers, keys of the scenario, references and what they are made of, results."""

from __future__ import annotations

from collections.abc import Sequence

from asrsim.actuators import ACTUATORS, MODES
from asrsim.document.block import declared_keys, key_at
from asrsim.quantities import linear_unit, unit_of
from asrsim.scenario.keys import SCENARIO
from asrsim.scenario.overrides import split_path
from asrsim.signals import SIGNALS
from asrsim.signals.common import VALUE
from asrsim.sweeps.cases import TIP, Payload


def units_of(payload: Payload) -> dict[str, str]:
    """Column -> SI unit, of the robot's numbers, keys of the scenario, results and kept signals that have one."""
    # Workers, which import this module, need nothing of fits.
    from asrsim.identification.keys import parameters_of

    prismatic = {name: case.robot.joint(name).kind == "prismatic" for case in payload.cases.values() for name in case.joints}
    found = {f"tip.{name}": "m" for name in TIP}
    for joint, slides in prismatic.items():
        length = "m" if slides else "rad"
        found |= {f"{joint}.{name}": length for name in ("steady_state", "steady_state_error", "peak_deflection")}
        found |= {f"{joint}.settling": "s", f"{joint}.frequency": "Hz"}
    for signal in payload.study.signals:
        joint, _, quantity = signal.rpartition(".")
        found[f"signal:{signal}"] = unit_of(quantity, prismatic=prismatic.get(joint, False))
    for case in payload.cases.values():
        numbers = parameters_of(case.robot, (), {})
        for key, places in {**case.plan.parameters, **case.plan.inertials}.items():
            units = {numbers[place].unit for owner, name in places if (place := f"{owner}.{name}") in numbers}
            found[key] = units.pop() if len(units) == 1 else ""
    known = {name for name, _ in payload.columns}
    for key in {key for axis in payload.study.axes for key in axis.keys} - found.keys():
        path = split_path(key)
        slides = any(prismatic.get(part) for part in path)
        own = getattr(key_at(SCENARIO, path), "unit", "")
        found[key] = _signal_unit(path, payload, slides=slides) or (linear_unit(own) if slides else own)
    return {name: unit for name, unit in found.items() if unit and name in known}


def _signal_unit(path: Sequence[str], payload: Payload, *, slides: bool) -> str:
    """Of a reference or external torque, or of a key of its signal (`references.hip.reference_1.step.to`); "" of others."""
    if path[0] == "references" and len(path) > 2:
        own, rest = _reference_unit(path[1], path[2], payload), path[3:]
    elif path[0] == "external_torques" and len(path) > 1:
        own, rest = "N m", path[2:]
    else:
        return ""
    own = linear_unit(own) if slides else own
    if len(rest) < 2 or rest[0] not in SIGNALS.names():
        return own if not rest else ""
    key = next((key for key in declared_keys(SIGNALS.get(rest[0])) if key.name == rest[1]), None)
    return "" if key is None else own if key.unit == VALUE else key.unit


def _reference_unit(joint: str, name: str, payload: Payload) -> str:
    """Of a reference by its name, which tells its unit in all modes; but an adjuster has its own."""
    slots = [(mode.references.index(name), mode.units) for mode in MODES.values() if name in mode.references]
    if not slots:
        return ""
    slot, units = slots[0]
    for case in payload.cases.values():
        types = {block.joint: block.actuator for block in case.robot.actuators}
        types |= {one: given.type for one, given in case.scenario({}).actuators.items()}
        actuator = types.get(joint) or types.get("*") or next(iter(types.values()), None)
        if slot and actuator is not None and ACTUATORS.get(actuator).adjuster:
            return ACTUATORS.get(actuator).reference_2_unit
    return units[slot]
