"""The text of a scenario from a recording: commands played, motion compared, and every guess in its comments."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from asrsim.actuators import MODES
from asrsim.actuators.user import command_line
from asrsim.errors import listed
from asrsim.quantities import is_comparable
from asrsim.recordings.data import Recording
from asrsim.recordings.units import split_header
from asrsim.scenario.starter import mounted_lines, robot_lines, word
from asrsim.scenario.starter_extract import file_of
from asrsim.scenario.starter_motion import number, starter_joint
from asrsim.scenario.starter_playback import Plan, Played

STEP = 0.001
"""s."""
SHARE = 0.1
"""Of the recorded range: the limit of a claim before the first comparison."""
EXACT = 1e-6
"""Of the recorded range: the least RMSE that is claimed; of a simulation's own log less would be the machine's rounding."""
UNKNOWN = (
    "Limits of motors are wide open, their constants, if any, 1, controllers' derivative gains 0, since they brake as damping "
    "does; springs that stand here hold the arm's own weight, which the defaults do not: write what is known."
)

STILL = 0.02
"""Share of the recorded range below which the simulation rests."""
APART = 0.25
"""Share of the recorded range beyond which simulation and recording are no pair."""


@dataclass(frozen=True, kw_only=True)
class Names:
    """Files as the scenario names them, from its own folder."""

    scenario: str
    robot: str
    recording: str
    extract: str
    parts: Mapping[Path, str] = field(default_factory=dict)
    """Of files that were joined, each as the scenario names it."""
    schema: str | None = None
    arguments: Mapping[str, str] = field(default_factory=dict)
    """Of xacro."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """Of ROS, with their folders."""
    plugins: tuple[str, ...] = ()
    """Files of users' actuators."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A limit on the RMSE of one quantity, and where it comes from."""

    joint: str
    quantity: str
    limit: float
    said: str
    active: bool = True
    """False: written as a comment, since the two have too little in common."""


def recording_text(
    plan: Plan, names: Names, claims: Sequence[Claim], *, mode: int | None = None, mounted: Sequence[str] = (),
    parameters: Mapping[str, Mapping[str, float]] | None = None, mapping: Sequence[str] = (), rate: float | None = None,
) -> str:  # fmt: skip
    """The scenario's YAML. mode, mapping, rate: as they were asked for on the command line, and are written down; mounted:
    joints whose actuator the scenario gives; parameters: those of these that are no defaults.
    """
    lines = [f"# yaml-language-server: $schema={names.schema}"] if names.schema else []
    lines += [*_head(plan, names, mapping, rate), "", *robot_lines(names.robot, names.arguments, names.packages)]
    lines += [
        f"duration: {exact(plan.duration)}".ljust(21) + "# s, of the recording",
        f"step: {number(STEP)}".ljust(21) + "# s",
        *(["engine: bench".ljust(21) + "# no motion of a link was recorded: they are locked"] if plan.on_bench else []),
    ]
    if mounted:
        lines += mounted_lines(plan.robot, mounted, parameters or {}, why=UNKNOWN)
    others = any(block.joint not in plan.modes for block in plan.robot.actuators)
    modes = {**({"*": mode} if mode is not None and others else {}), **plan.modes}
    modes = {joint: number for joint, number in modes.items() if joint not in mounted}
    if modes and len(mounted) < len(plan.robot.actuators):
        lines.append("modes: {" + ", ".join(f"{word(joint)}: {value}" for joint, value in modes.items()) + "}")
    if plan.initial:
        lines += ["initial:".ljust(21) + "# rad, m; where the recording begins"]
        lines += [f"  {word(joint)}: {value!r}" for joint, value in plan.initial.items()]
    if plan.robot.actuators:
        lines += ["", "references:", *_references(plan, names)]
    torques = [one for one in plan.played if one.slot is None]
    if torques:
        lines += ["", "external_torques:"]
        lines += [f"  {word(one.joint)}: {_playback(plan, one, names)}  # {one.column.source}" for one in torques]
    lines += ["", *_expect(plan, names, claims, mapping, rate)]
    return "\n".join(lines) + "\n"


def placeholders(plan: Plan) -> list[Claim]:
    """A claim for each quantity that is compared: an RMSE of a tenth of the recorded range, before any comparison."""
    claims = []
    for joint, column in plan.compared:
        values = column.values[np.isfinite(column.values)]
        extent = float(np.ptp(values))
        if extent > 0.0 and is_comparable(str(column.quantity)):
            said = f"a placeholder: {100 * SHARE:g} % of the recorded range"
            claims.append(Claim(joint=joint, quantity=str(column.quantity), limit=_rounded(SHARE * extent), said=said))
    return claims


def _head(plan: Plan, names: Names, mapping: Sequence[str], rate: float | None) -> Iterator[str]:
    recording = plan.recording
    name = Path(names.scenario).stem
    recorded = shlex.quote(names.recording)
    log = shlex.quote(f"out/{name}/default/log.mcap")
    options = [
        f"--lag {exact(plan.lag)}",
        *(f"--map {shlex.quote(text)}" for text in mapping),
        *([f"--rate {rate:g}"] if rate else []),
    ]
    yield f"# Scenario from the recording {names.recording}, written by `asrsim init --experiment`."
    yield "# It plays the recorded commands into the simulation and compares the motion with the recorded one. Units are SI."
    yield f"#   {command_line('run', names.scenario, names.plugins)}"
    yield f"#   asrsim plot {log} --experiment {recorded} {' '.join(options)}"
    yield "#"
    yield f"# How the file was read ({recording.format}, {_sampling(recording)}); --map COLUMN=JOINT.QUANTITY corrects it:"
    rows = [column for column in recording.channels.values() if column.quantity]
    cells = [("column", "read as", "unit", "conversion", "why")]
    cells += [(row.source, row.meaning, row.unit, row.conversion, row.origin) for row in rows]
    widths = [min(34, max(len(line[i]) for line in cells)) for i in range(4)]
    for line in cells:
        yield "#   " + "  ".join(text.ljust(width) for text, width in zip(line, [*widths, 0], strict=True)).rstrip()
    unused = [column.source for column in recording.channels.values() if not column.quantity]
    if unused:
        yield from _wrapped(f"not used: {listed(unused, 12)}", "#   ")
    said = [*plan.remarks, *(f"{p.key}: {p.message}" if p.key else p.message for p in recording.findings)]
    if said:
        yield "# Assumed, or odd about the file:"
        for text in said[:20]:
            yield from _wrapped(text, "#   - ")
        if len(said) > 20:
            yield f"#   - and {len(said) - 20} more"
    if plan.lag:
        yield f"# The recording begins at {exact(plan.lag)} s of its own clock, which is 0 here."
    extracted = [one for one in plan.played if not one.direct]
    if extracted:
        yield f"# The commands are played from {names.extract} beside this file: cleaned, in SI, on the recording's clock."


def _sampling(recording: Recording) -> str:
    step = float(np.median(np.diff(recording.time)))
    return f"{len(recording.time)} samples at {1 / step:.4g} Hz"


def _references(plan: Plan, names: Names) -> Iterator[str]:
    for block in plan.robot.actuators:
        mode = MODES[block.mode]
        drive = starter_joint(plan.robot, block)
        own = {one.slot: one for one in plan.played if one.joint == block.joint and one.slot is not None}
        yield f"  {word(block.joint)}:  # {drive.actuator.title}, mode {mode.number} ({mode.name}: {mode.doc})"
        presets = drive.presets()
        preset = presets[0] if presets else drive.actuator.typical_preset
        for slot, (name, unit, rest) in enumerate(drive.levels(plan.initial.get(block.joint, 0.0), 0.0, preset)):
            one = own.get(slot)
            if one is not None:
                yield f"    {name}: {_playback(plan, one, names)}  # {one.column.unit or unit}, {one.column.source}"
            else:
                yield f"    {name}: {number(rest)}  # {unit}, not recorded"


def _playback(plan: Plan, one: Played, names: Names) -> str:
    file, column = (names.recording, one.column.source) if one.direct else (file_of(plan, one, names.extract), one.label)
    keys = [f"file: {word(file)}", f"column: {word(column)}"]
    if plan.lag:
        keys.append(f"start: {exact(float(one.column.time[0]) - plan.lag)}")
    keys.append(f"interpolation: {'hold' if one.hold else 'smooth'}")
    return f"{{playback: {{{', '.join(keys)}}}}}"


def _expect(plan: Plan, names: Names, claims: Sequence[Claim], mapping: Sequence[str], rate: float | None) -> Iterator[str]:
    if not claims:
        yield "# Nothing that the simulation has was recorded beside the commands: there is nothing to compare."
        return
    yield "# The limits say how near the model is today, not how near it should be: put what the laboratory needs."
    if not any(claim.active for claim in claims):
        yield "# expect:"
    else:
        yield "expect:"
    for claim in claims:
        yield f"  # {claim.said}"
        against = _against(plan, names, claim, mapping, rate)
        yield (
            f"  {'' if claim.active else '# '}- {{joint: {word(claim.joint)}, quantity: {claim.quantity}, measure: rmse, "
            f"comparison: <, value: {number(claim.limit)}, {against}}}"
        )


def _against(plan: Plan, names: Names, claim: Claim, mapping: Sequence[str], rate: float | None) -> str:
    """The recording and how it is read; of joined files the one that has the column, on its own clock."""
    column = next(column for joint, column in plan.compared if (joint, column.quantity) == (claim.joint, claim.quantity))
    file, lag = names.recording, plan.lag
    if column.part is not None:
        file, lag = names.parts[column.part], plan.lag - column.shift
        spelled = {text.rpartition("=")[0].strip(): text.rpartition("=")[2] for text in mapping}
        target = (
            spelled.get(column.source) or spelled.get(split_header(column.source)[0]) or f"{column.joint}.{column.quantity}"
        )
        mapping = [f"{column.label}={target}"]
    options = [f"lag: {exact(lag)}"]
    if mapping:
        options.append(f"map: [{', '.join(word(text) for text in mapping)}]")
    if rate:
        options.append(f"rate: {rate:g}")
    return f"against: {word(file)}, options: {{{', '.join(options)}}}"


def exact(value: float) -> str:
    """A number as YAML, to twelve digits: times of long recordings need them."""
    return f"{value + 0.0:.12g}"


def _wrapped(text: str, first: str) -> list[str]:
    """Lines of a comment that begins with `first`."""
    return textwrap.wrap(" ".join(text.split()), 124, initial_indent=first, subsequent_indent="#     ", break_long_words=False)


def _rounded(value: float) -> float:
    """Upwards to two digits."""
    digits = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / digits - 1e-9) * digits)


@dataclass(frozen=True, kw_only=True)
class First:
    """What the first comparison of a quantity gave."""

    rmse: float
    nrmse: float
    """Share of the recorded range."""
    r2: float
    """Below 0 a constant would be nearer to the recording than the simulation is."""
    moved: float
    """Range of the simulation as a share of the recorded one."""

    @property
    def doubt(self) -> str:
        """Why a limit from this comparison would say nothing; "" where it says something."""
        if self.moved < STILL:
            return "the simulation does not move"
        if self.r2 < 0.0:
            return f"R2 is {self.r2:.2g}, so that a constant would be nearer; another zero, sign or unit, or not modelled?"
        return "" if self.nrmse < APART else "another unit, side of a gear or zero, or not modelled?"


def first_claims(plan: Plan, measured: Mapping[tuple[str, str], First]) -> list[Claim]:
    """Claims from the first comparison, by joint and quantity; a fifth above its RMSE. Others are placeholders, not claimed."""
    claims = []
    for claim in placeholders(plan):
        first = measured.get((claim.joint, claim.quantity))
        if first is None:
            claim = replace(claim, active=False)
        elif first.rmse > 0.0:
            rmse = first.rmse
            said = f"{rmse:.3g} in the first comparison, {100 * first.nrmse:.3g} % of the recorded range"
            active = not first.doubt
            said += "" if active else f": {first.doubt}"
            limit = _rounded(1.2 * rmse * max(1.0, EXACT / first.nrmse))
            claim = Claim(joint=claim.joint, quantity=claim.quantity, limit=limit, said=said, active=active)
        claims.append(claim)
    return claims
