"""Description of the run in its log: converts RunInfo to attachments and metadata, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from asrsim import __version__
from asrsim.errors import LogError
from asrsim.plain import PlainShape, misfit
from asrsim.samples import JointInfo, RunInfo

FORMAT = "1"
"""Version of the log's layout; incremented when an older reader would misread a newer log."""
RUN_METADATA = "asrsim"
RESULT_METADATA = "asrsim_result"

_RUN, _URDF, _SCENARIO, _RESOLVED = "run.json", "robot.urdf", "scenario.yaml", "resolved.json"
_FOLDER = "attachments/"
_COPIED = ("robot", "variant", "step", "log_every", "urdf_path", "scenario_path")
"""Fields of `RunInfo` that `run.json` contains unchanged."""
_JOINT_SHAPE: PlainShape = {
    "name": str,
    "actuator": str,
    "mode": (int, None),
    "namespace": str,
    "motors": int,
    "prismatic": bool,
    "quantities": [str],
}
_RUN_SHAPE: PlainShape = {
    "robot": str,
    "variant": str,
    "step": float,
    "log_every": int,
    "urdf_path": str,
    "scenario_path": str,
    "joints": [_JOINT_SHAPE],
    "metadata": {"*": str},
}
_RESOLVED_SHAPE: PlainShape = {
    "scenario?": {"robot": (str, {"file": str}), "*": object},
    "parameters?": {"*": {"*": float}},
    "*": object,
}


def info_attachments(info: RunInfo) -> dict[str, tuple[str, bytes]]:
    """Attachments needed to repeat the run: name -> (media type, data). `run.json` contains all data without a file."""
    run = {
        "format": FORMAT,
        **{name: getattr(info, name) for name in _COPIED},
        "joints": [vars(joint) for joint in info.joints],
        "metadata": dict(info.metadata),
    }
    files = {
        _RESOLVED: ("application/json", json.dumps(dict(info.resolved)).encode()),
    }
    if info.urdf:
        files[_URDF] = ("application/xml", info.urdf.encode())
    if info.scenario:
        files[_SCENARIO] = ("application/yaml", info.scenario.encode())
    files |= {_FOLDER + name: ("application/octet-stream", bytes(data)) for name, data in info.attachments.items()}
    # Write run.json as the last attachment, so that a truncated file with run.json contains all attachments.
    files[_RUN] = ("application/json", json.dumps(run).encode())
    return files


def info_metadata(info: RunInfo) -> dict[str, str]:
    """Content of the metadata record `asrsim`, for people and for tools that list metadata."""
    return {
        "asrsim_version": __version__,
        "log_format": FORMAT,
        **{name: str(getattr(info, name)) for name in ("robot", "variant", "step", "log_every")},
        **info.metadata,
    }


def info_from(attachments: Mapping[str, bytes]) -> RunInfo:
    """RunInfo of a log. Raises LogError if another program or a newer asrsim wrote the log."""
    run = _run_of(attachments)
    joints = tuple(JointInfo(**{**joint, "quantities": tuple(joint["quantities"])}) for joint in run["joints"])
    names = [joint.name for joint in joints]
    if len(set(names)) < len(names):
        raise _damaged(f"{_RUN} lists a joint twice")
    try:
        urdf, scenario = (attachments.get(name, b"").decode() for name in (_URDF, _SCENARIO))
    except UnicodeDecodeError as error:
        raise _damaged(str(error)) from error
    return RunInfo(
        **{name: run[name] for name in _COPIED},
        joints=joints,
        urdf=urdf,
        scenario=scenario,
        resolved=_json(_RESOLVED, attachments.get(_RESOLVED, b"{}"), _RESOLVED_SHAPE),
        metadata=run["metadata"],
        attachments={name.removeprefix(_FOLDER): data for name, data in attachments.items() if name.startswith(_FOLDER)},
    )


def origin_from(attachments: Mapping[str, bytes]) -> tuple[str, str]:
    """Scenario file and variant of a log. Raises LogError as `info_from`, which reads all attachments."""
    run = _run_of(attachments)
    return run["scenario_path"], run["variant"]


def _run_of(attachments: Mapping[str, bytes]) -> Any:
    """Content of `run.json`: the description of the run without the parts that are separate attachments. Raises LogError."""
    if _RUN not in attachments:
        raise LogError(
            "this MCAP file was not written by asrsim, or ends before its description",
            hint="If it is a recording of a robot, read it with `asrsim plot LOG --experiment FILE`",
            code="foreign-log",
        )
    run = _json(_RUN, attachments[_RUN], {"format": object, "*": object})
    if run["format"] != FORMAT:
        raise LogError(
            "this version of asrsim cannot read the format of the log",
            value=run["format"],
            choices=(FORMAT,),
            hint="Read it with the version of asrsim that wrote it",
            code="log-format",
        )
    _fit(_RUN, run, _RUN_SHAPE)
    if not 0 < run["step"] < 1e300 or run["log_every"] < 1:
        raise _damaged(f"{_RUN}: step and log_every must be larger than 0")
    return run


def _json(name: str, data: bytes, shape: PlainShape) -> Any:
    """JSON content of an attachment, which may have been edited. Raises LogError unless it has the expected structure."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise _damaged(f"{name}: {error}") from error
    _fit(name, found, shape)
    return found


def _fit(name: str, found: Any, shape: PlainShape) -> None:
    """Raise LogError unless the content of an attachment has the expected structure."""
    if fault := misfit(found, shape):
        raise _damaged(f"{name}: {fault}")


def _damaged(what: str) -> LogError:
    return LogError(f"the description of the run is damaged: {what}", code="corrupt-log")
