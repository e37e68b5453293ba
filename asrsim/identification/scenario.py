"""The scenario that a fit writes. It repeats the first recording with the fitted robot, and claims that the error is not much
larger than the error of the fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from asrsim.identification.folder import FIT
from asrsim.identification.parameters import tied
from asrsim.identification.replay import played_table
from asrsim.identification.result import NO_EFFECT, FitResult
from asrsim.identification.resume import Resumed
from asrsim.outfile import write_text
from asrsim.plain import mapped
from asrsim.robot.model import ActuatorBlock
from asrsim.robot.mounting import reference_names, sprung_joints
from asrsim.scenario.data import for_joint
from asrsim.scenario.relocate import relative_path, relocated, robot_key
from asrsim.signals import Constant
from asrsim.signals.playback import Playback

SCENARIO = "scenario.yaml"
SLACK = 1.2
"""Largest error of the fitted scenario that its claims allow, relative to the error of the fit. Results of engines differ
slightly.
"""
CLOCKS = 1e-6
"""Largest difference between the start of a command in the fit and in a run of the scenario, s."""


def write_scenario(
    result: FitResult | Resumed, changes: Mapping[str, Mapping[str, float]], robot: Path
) -> tuple[list[Path], list[str]]:
    """Write the scenario and the commands that it plays to the folder of the fitted robot. Return paths and remarks.

    changes: fitted numbers by joint or link and by name; robot: file of the fitted robot.
    """
    folder, delays = robot.parent, _delays_by_joint(result)
    files, shifts = _written_commands(result, delays, folder)
    write_text(folder / SCENARIO, _scenario_text(result, changes, delays, shifts, robot), "fitted scenario")
    return [folder / SCENARIO, *files], [*_delays_not_written(result, delays, shifts)]


def _delays_by_joint(result: FitResult | Resumed) -> dict[str, float]:
    """Delays that the scenario states, s, by joint. A scenario states one delay for all references of a joint, so use the delay
    of the reference with the narrowest interval. Joints whose references have different delays are left out.
    """
    found: dict[str, float] = {}
    for block in result.robot.actuators:
        late = [*_delays(result, block)]
        delay, own = min(late, key=lambda one: one[1], default=(0.0, 0.0))
        if delay > 0.0 and all(abs(delay - other) <= own + margin for other, margin in late):
            found[block.joint] = delay
    return found


def _delays(result: FitResult | Resumed, block: ActuatorBlock) -> Iterator[tuple[float, float]]:
    """Delay of each reference of a joint, and half the width of the delay's interval, s. References that a delay does not
    affect are left out.

    A delay has no effect on a constant reference. References whose delay was free but had no effect are left out, too.
    """
    known = {one.key: one for one in result.estimates}
    estimates = tied({one.key: one.value for one in result.estimates if one.verdict != NO_EFFECT}, result.ties)
    signals, free = result.scenario.references_of(block.joint), {*known} | {tie.key for tie in result.ties}
    for i, name in enumerate(reference_names(block), start=1):
        key = f"{block.joint}.reference_{i}.delay"
        if key in estimates:
            one = known.get(key)
            yield estimates[key], 0.5 * (one.high - one.low) if one is not None and one.has_interval else 0.0
        elif key not in free and not isinstance(signals.get(name, Constant(value=0.0)), Constant):
            yield 0.0, 0.0


def _written_commands(
    result: FitResult | Resumed, delays: Mapping[str, float], folder: Path
) -> tuple[list[Path], dict[str, tuple[float, str]]]:
    """Write the commands that a run plays instead of the recorded commands. Return the files and, by the key of each command,
    the delay of its samples in s and the name of its file.

    A command is also written if the scenario plays it at other times than the fit. The written samples include the zero
    offsets, scales and instants of jumps, and the delays that `imperfections` of the scenario cannot state.
    """
    files, shifts = list[Path](), dict[str, tuple[float, str]]()
    recorded = {command.key: command for command in result.played}
    for number, reading in enumerate(result.replay.commands, start=1):
        late = 0.0 if reading.joint in delays else reading.late
        signal = result.scenario.references_of(reading.joint).get(reading.reference)
        if not isinstance(signal, Playback):
            continue
        # The scenario's playback may begin at another time than the command did in the fit, for example because of its `start`.
        moved = abs(float(signal.samples[0][0] - recorded[reading.key].time[0])) > CLOCKS
        if reading.corrected or late or moved:
            files.append(folder / f"command_{number}.csv")
            write_text(files[-1], played_table(recorded[reading.key], reading, late), "fitted command")
            shifts[reading.key] = late, files[-1].name
    return files, shifts


def _delays_not_written(
    result: FitResult | Resumed, delays: Mapping[str, float], shifts: Mapping[str, tuple[float, str]]
) -> Iterator[str]:
    """Sentences on estimated delays that neither the scenario nor a file of commands contains."""
    for joint in dict.fromkeys(one.joint for one in result.replay.commands):
        late = [one for one in result.replay.commands if one.joint == joint and one.late]
        if joint in delays or all(one.key in shifts for one in late):
            continue
        negative = all(one.late < 0.0 for one in late)
        why = "it is negative (the command was recorded late)" if negative else "the delays of its references differ"
        yield f"the delay of {joint} is not written, since {why}, and the scenario does not play the recorded command"


def rotors_of_scenario(result: FitResult | Resumed, changes: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Fitted rotor inertias that the scenario must state, kg m^2 (kg for prismatic joints), by joint. A rotor inertia in the
    robot file has no effect if the joint has a spring, or if the scenario states another value.
    """
    sprung, given = sprung_joints(result.robot), result.scenario.armature
    return {
        owner: _rounded(own["armature"])
        for owner, own in changes.items()
        if "armature" in own and (owner in sprung or for_joint(given, owner, None) is not None)
    }


def _scenario_text(
    result: FitResult | Resumed, changes: Mapping[str, Mapping[str, float]], delays: Mapping[str, float],
    shifts: Mapping[str, tuple[float, str]], robot: Path,
) -> str:  # fmt: skip
    """Text of a scenario for `asrsim run` with the fitted robot and parameters."""
    import yaml

    folder = robot.parent
    data = relocated(result.scenario, folder)
    data["references"] = _as_played(result, data.get("references") or {}, shifts)
    data["robot"] = robot_key(robot, folder, None, result.scenario.package_paths)
    data["parameters"] = data.get("parameters") or {}
    for block in result.robot.actuators:
        own = {name: _rounded(v) for name, v in changes.get(block.joint, {}).items() if name in block.parameters}
        if own:
            data["parameters"].setdefault(block.joint, {}).update(own)
    if rotors := rotors_of_scenario(result, changes):
        data["armature"] = {**result.scenario.armature, **rotors}
    if delays:
        imperfections = data["imperfections"] = data.get("imperfections") or {}
        commands = imperfections["commands"] = imperfections.get("commands") or {}
        for joint, delay in delays.items():
            before = for_joint(commands, joint, {})
            commands[joint] = {**before, "delay": _rounded(before.get("delay", 0.0) + delay)}
    if result.replay.initial and not result.scenario.initial_equilibrium:
        data["initial"] = {**(data.get("initial") or {}), **_starts(result.replay.initial)}
    if claims := [*_claims(result, shifts, folder)]:
        data["expect"] = claims
    lines = [
        "# Scenario with the parameters that `asrsim identify` found; inertias, damping and friction are in the robot.",
        f"# Intervals and verdicts are in {FIT}.",
        *(f"# The model does not fit: {text}" for text in result.misfit),
    ]
    return "\n".join(lines) + "\n" + yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def _as_played(
    result: FitResult | Resumed, references: Mapping[str, Any], shifts: Mapping[str, tuple[float, str]]
) -> dict[str, Any]:
    """References of the scenario. In the result, playbacks repeat the commands as the fit played them."""
    found = {joint: {**own} if isinstance(own, Mapping) else own for joint, own in references.items()}
    for one in result.replay.commands:
        place = one.joint if one.joint in found else "*"
        playback = _playback_of(found.get(place), one.reference)
        if one.key in shifts:
            playback = {"file": shifts[one.key][1], "column": one.key}
        if playback is not None:
            found[place][one.reference] = {"playback": {**playback, "interpolation": one.interpolation}}
    return found


def _playback_of(references: Any, name: str) -> dict[str, Any] | None:
    """Keys and values of a reference's playback; None if the reference is not a playback that is written with keys."""
    signal = references.get(name) if isinstance(references, Mapping) else None
    keys = signal.get("playback") if isinstance(signal, Mapping) and len(signal) == 1 else None
    return {**keys} if isinstance(keys, Mapping) else None


def _rounded(value: float) -> float:
    """Number rounded to nine digits, as in the fitted robot file."""
    return float(f"{value:.9g}")


def _starts(initial: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Initial positions and velocities of joints, rounded to nine digits."""
    plain: dict[str, Any] = mapped(initial, lambda value: _rounded(value) if isinstance(value, float) else value)
    return plain


def _claims(result: FitResult | Resumed, shifts: Mapping[str, tuple[float, str]], folder: Path) -> Iterator[dict[str, Any]]:
    """Claims that the difference between the run and the recording is about as large as in the fit. There are no claims if the
    run does not play all recorded commands. The claims read the recording with the estimated zero offsets, scales and delays of
    its sensors and with its clock offset. `asrsim plot` reads it in the same way.
    """
    replay, signals = result.replay, result.scenario.references_of
    if not all(isinstance(signals(one.joint).get(one.reference), Playback) for one in replay.commands):
        return
    series = [
        *((one, one.late) for one in replay.channels),
        *((one, -shifts.get(one.key, (0.0,))[0]) for one in replay.commands),
    ]
    options = {"lag": float(f"{replay.lag:.12g}"), "map": [one.item(late) for one, late in series]}
    options |= {} if replay.rate is None else {"rate": replay.rate}
    for one in replay.channels:
        joint, _, quantity = one.key.rpartition(".")
        limit = float(f"{SLACK * one.error:.3g}")
        yield {
            "joint": joint, "quantity": quantity, "measure": "rmse", "comparison": "<", "value": limit,
            "against": relative_path(Path(replay.recording), folder), "options": options,
        }  # fmt: skip
