"""Laws that residuals show to be missing: springs whose stiffness goes with the amplitude, hysteresis and friction."""

from __future__ import annotations

import numpy as np

from asrsim.identification.intervals import BLOCKS
from asrsim.identification.residuals import Residuals
from asrsim.samples import Array

LAGS = 0.3
"""Share of a torque's residuals, squared, from which on they go with the direction of its change."""
TREND = 0.6
"""Rank correlation of a spring's estimate in parts of the record with their deflection, beyond which it depends on it."""


def block_estimates(residuals: Residuals, x: Array, jacobian: Array, count: int = BLOCKS) -> tuple[Array, Array, Array]:
    """One step of the estimate in each block alone: (blocks, n) moves, their deviations, and each residual's block."""
    left, numbers = residuals(x), residuals.blocks(count)
    n = jacobian.shape[1]
    total = int(numbers.max()) + 1
    moves, errors = np.full((total, n), np.nan), np.full((total, n), np.nan)
    for block in range(total):
        mine = numbers == block
        for i in range(n):
            size = float(jacobian[mine, i] @ jacobian[mine, i])
            if size > 0.0:
                moves[block, i] = -float(jacobian[mine, i] @ left[mine]) / size
                errors[block, i] = 1.0 / np.sqrt(size)
    return moves, errors, numbers


def amplitude(residuals: Residuals, x: Array) -> list[str]:
    """Springs whose estimates go with the deflection, in the parts of the record."""
    from scipy.stats import spearmanr

    springs = [
        i for i, entry in enumerate(residuals.layout.entries)
        if any(word in entry.name for word in ("spring_stiffness", "spring_k", "passive_stiffness", ".k"))
        and entry.parameter.logarithmic
    ]  # fmt: skip
    if not springs:
        return []
    jacobian = residuals.jacobian(x)
    moves, errors, numbers = block_estimates(residuals, x, jacobian, 12)
    reach = np.array([np.sqrt(np.mean(np.sum(jacobian[numbers == b][:, springs] ** 2, axis=1))) for b in range(len(moves))])
    found = []
    for i in springs:
        told = errors[:, i] < 0.2
        if told.sum() < 6:
            continue
        rank = float(spearmanr(reach[told], moves[told, i]).statistic)
        extent = float(np.ptp(moves[told, i]))
        if abs(rank) > TREND and extent > 6.0 * float(np.median(errors[told, i])) and extent > 0.02:
            way = "falls" if rank < 0.0 else "grows"
            found.append(
                f"{residuals.layout.entries[i].name} {way} with the amplitude: parts of the record differ by "
                f"{100 * extent:.0f} %; a spring whose law is another is missing"
            )
    return found


def hysteresis(residuals: Residuals, x: Array) -> list[str]:
    """Residuals that go with the sign of a channel's velocity."""
    found: dict[str, tuple[float, str]] = {}
    for track, one in enumerate(residuals.tracks):
        raw = residuals.raw(x, track, residuals.until(track))
        if raw is None:
            continue
        modes = {drive.name: drive.mode for drive in one.prepared.drives}
        for channel, left in zip(one.channels, raw, strict=True):
            if "torque" not in channel.quantity:
                continue
            sign = np.sign(np.gradient(np.convolve(channel.values[: len(left)], np.ones(5) / 5.0, "same")))
            size = abs(float(np.mean(left * sign)))
            if size**2 <= LAGS * max(float(np.mean(left**2)), 1e-300) or size < found.get(channel.key, (0.0, ""))[0]:
                continue
            mode = modes.get(channel.joint)
            spring = [f"{channel.joint}.hysteresis_torque={size:.2g}"] if mode and mode.spring else []
            # A link that stands where it is put has no friction.
            rubs = [f"{channel.joint}.stribeck_friction={size:.2g}"] if one.scenario.engine != "bench" else []
            flags = " ".join(f"--free {flag}" for flag in (*spring, *rubs))
            what = " or ".join([*(["hysteresis"] if spring else []), *(["friction"] if rubs else [])])
            found[channel.key] = size, f"{channel.unit} off by the direction of its change: {what} is missing ({flags})"
    return [f"{key} is {size:.3g} {text}" for key, (size, text) in found.items()]
