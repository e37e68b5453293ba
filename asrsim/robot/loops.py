"""Closed chains with one degree of freedom, in which points of links coincide with points of other links.

A linkage is a group of joints that one joint, the master, moves: the joints of a loop, the joints of further loops that share
joints with it, and all joints coupled to these joints. J is the Jacobian of the gaps of its loops and couplings, with columns
J_m of the master and J_f of the followers. At unit velocity of the master, the followers have the velocities `ratio`: J_f ratio
= -J_m. At constant velocity of the master, they have the accelerations `gamma`: J_f gamma = -dJ/dt v. The two systems are
solved by least squares, since a planar loop has fewer equations than the three components of its gap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from asrsim.errors import Problem, RobotError, listed
from asrsim.robot.poses import HERE, cross_matrix

if TYPE_CHECKING:
    from asrsim.robot.model import Joint, Robot, Vector

Array = NDArray[np.float64]
OPEN = 1e-9
"""Largest gap of a closed loop, m."""
ROUNDED = 1e-4
"""Largest gap, if the followers cannot reduce it, that counts as rounding of the numbers in the file, m; chosen for CAD
exports.
"""
GROWN = 0.99 * ROUNDED
"""Gap at which the range of a linkage ends, m."""
DEAD = 1e-6
"""Ratio of the smallest to the largest singular value of the derivatives of a linkage's gaps by its followers, below which the
master is at a dead centre.
"""
ROUNDS = 25
"""Largest number of rounds of Newton's method."""
STRIDE = 0.15
"""Largest motion of a joint between two postures of a traced linkage, rad."""
SHORTEST = 1e-7
"""Step of the master, as a fraction of 1 rad, below which a linkage that does not close counts as being at its dead centre."""
POSTURES = 4000
"""Largest number of postures of a traced linkage in one direction."""
TRIALS, ENOUGH = 200, 8
"""TRIALS: number of random postures from which closed postures are sought; ENOUGH: number of closed postures that end this
search."""
SLACK = 1e-7
"""Largest distance of an initial position beyond a limit that counts as rounding, rad (m)."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A loop that is closed where a point of one link coincides with a point of another link."""

    links: tuple[str, str]
    points: tuple[Vector, Vector]
    """Points in the frames of the links, m."""
    master: str = ""
    """Joint that the other joints of the loop follow; empty: the first of the loop's joints that has an actuator, else the
    first joint.
    """


@dataclass(frozen=True, kw_only=True)
class LoopPath:
    """Joints between the links of a loop and the common body of these links: first the joints of the first side, then the
    joints of the second side."""

    joints: tuple[int, ...]
    """Indices of the joints among the robot's moving joints."""
    split: int
    """Number of joints on the first side."""
    slides: tuple[bool, ...]
    origins: tuple[Array, ...]
    """Position (3,) of each joint's frame relative to the previous joint, m."""
    turns: tuple[Array, ...]
    """Rotation (3, 3) of each joint's frame relative to the previous joint."""
    axes: tuple[Array, ...]
    """Axis (3,) of each joint in its frame."""
    ends: Array
    """Points (6,) that coincide, in the frames after the last joints of the two sides, m."""

    def equations(self, q: Array) -> tuple[Array, Array, Array]:
        """Gap (..., 3) in m, its derivatives (..., 3, k) by the positions of `joints`, and the axes (..., 3, k)."""
        gap, columns, axes = np.zeros((*q.shape[:-1], 3)), [], []
        for side, sign in enumerate((1.0, -1.0)):
            rotation = np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3))
            point, places = np.zeros_like(gap), []
            members = range(self.split) if side == 0 else range(self.split, len(self.joints))
            for k in members:
                point = point + rotation @ self.origins[k]
                rotation = rotation @ self.turns[k]
                axis, position = rotation @ self.axes[k], q[..., self.joints[k], None]
                axes.append(axis)
                places.append(point)
                if self.slides[k]:
                    point = point + axis * position
                else:
                    first, second = self._twists[k]
                    rotation = rotation @ (
                        np.eye(3) + np.sin(position)[..., None] * first + (1.0 - np.cos(position))[..., None] * second
                    )
            point = point + rotation @ self.ends[3 * side : 3 * side + 3]
            gap = gap + sign * point
            columns += [
                sign * (axes[k] if self.slides[k] else _cross(axes[k], point - place))
                for k, place in zip(members, places, strict=True)
            ]
        return gap, np.stack(columns, axis=-1), np.stack(axes, axis=-1)

    def drift(self, columns: Array, axes: Array, v: Array) -> Array:
        """Second derivative (..., 3) of the gap at constant velocities v (..., joints), m/s^2."""
        found = np.zeros(columns.shape[:-1])
        for members in (range(self.split), range(self.split, len(self.joints))):
            for k in members:
                for i in members:
                    near, far = min(i, k), max(i, k)
                    if not self.slides[near]:
                        rate = (v[..., self.joints[i]] * v[..., self.joints[k]])[..., None]
                        found = found + rate * _cross(axes[..., near], columns[..., far])
        return found

    @cached_property
    def _twists(self) -> list[tuple[Array, Array]]:
        """Matrix of the cross product with each joint's axis, and the square of this matrix."""
        twists = [cross_matrix(axis) for axis in self.axes]
        return [(twist, twist @ twist) for twist in twists]


def _cross(a: Array, b: Array) -> Array:
    """Cross products (..., 3); several times faster than NumPy's for few vectors."""
    product = a[..., :, None] * b[..., None, :]
    spare = product - np.swapaxes(product, -1, -2)
    return np.asarray(spare[..., (1, 2, 0), (2, 0, 1)])


@dataclass(frozen=True, kw_only=True)
class MimicJoint:
    """A joint of a linkage that mimics another joint: its position is `ratio` times the position of the other joint, plus
    `offset`.
    """

    follower: int
    leader: int
    ratio: float
    offset: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Linkage:
    """Joints that one joint moves through loops. Arrays of positions (..., n) contain the positions of all moving joints."""

    joints: tuple[int, ...]
    """Indices of the joints among the robot's moving joints; the first index is the master's."""
    loops: tuple[int, ...]
    """Indices of the linkage's loops among the loops of the robot."""
    paths: tuple[LoopPath, ...]
    ties: tuple[MimicJoint, ...]
    size: float
    """Typical length in m, which is the weight of the couplings among the equations."""
    start: Array
    """Initial positions (n,) of all joints. The loops are closed there if positions near the stated positions close them."""
    stops: Array
    """Lower and upper limits (n, 2) of all joints, rad or m."""
    slides: NDArray[np.bool_]
    """Whether each joint (n,) is prismatic."""

    @property
    def master(self) -> int:
        """Index of the master among the robot's moving joints."""
        return self.joints[0]

    def equations(self, q: Array) -> tuple[Array, Array]:
        """Gaps (..., r) and their derivatives (..., r, k) by the positions of `joints`, in m."""
        gaps, blocks = [], []
        for path in self.paths:
            gap, columns, _ = path.equations(q)
            block = np.zeros((*gap.shape, len(self.joints)))
            block[..., [self.joints.index(j) for j in path.joints]] = columns
            gaps.append(gap)
            blocks.append(block)
        for tie in self.ties:
            gap = self.size * (q[..., tie.follower] - tie.ratio * q[..., tie.leader] - tie.offset)
            block = np.zeros((*gap.shape, 1, len(self.joints)))
            block[..., 0, self.joints.index(tie.follower)] = self.size
            block[..., 0, self.joints.index(tie.leader)] = -self.size * tie.ratio
            gaps.append(gap[..., None])
            blocks.append(block)
        return np.concatenate(gaps, axis=-1), np.concatenate(blocks, axis=-2)

    def ratios(self, q: Array) -> Array:
        """Velocity (..., k) of each joint of the linkage per velocity of the master."""
        _, jacobian = self.equations(q)
        followers = -np.linalg.pinv(jacobian[..., 1:], rcond=1e-13) @ jacobian[..., :1]
        return np.concatenate([np.ones((*q.shape[:-1], 1)), followers[..., 0]], axis=-1)

    def gamma(self, q: Array, v: Array) -> Array:
        """Acceleration (..., k) of each joint of the linkage at constant velocity of the master; v: velocities (..., n)."""
        drifts = [path.drift(*path.equations(q)[1:], v) for path in self.paths]
        drift = np.concatenate([*drifts, np.zeros((*q.shape[:-1], len(self.ties)))], axis=-1)
        _, jacobian = self.equations(q)
        followers = -np.linalg.pinv(jacobian[..., 1:], rcond=1e-13) @ drift[..., None]
        return np.concatenate([np.zeros((*q.shape[:-1], 1)), followers[..., 0]], axis=-1)

    def close(self, q: Array, *, first: int = 1) -> Array:
        """Closed positions (..., n) near the given positions. The joints of the linkage with index `first` or more are moved to
        close the loops.
        """
        q, moved = q.copy(), list(self.joints[first:])
        for _ in range(ROUNDS):
            gap, jacobian = self.equations(q)
            step = -(np.linalg.pinv(jacobian[..., first:], rcond=1e-9) @ gap[..., None])[..., 0]
            # Approach a distant posture by short steps, so that the search does not jump to another branch of closed postures.
            q[..., moved] += step * np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=-1, keepdims=True), 1e-300))
            # Stop if the next step of Newton's method would be smaller than rounding errors.
            if not np.abs(step).max(initial=0.0) > 1e-9:
                break
        return q

    def gap(self, q: Array) -> float:
        """Largest gap of the loops and couplings at the positions q (n,), m."""
        return float(np.abs(self.equations(q)[0]).max())

    def closes(self, q: Array) -> bool:
        """Whether the loops are closed at the positions q (n,), up to rounding errors that no motion of the followers
        reduces.
        """
        gaps, jacobian = self.equations(q)
        gap, followers = np.abs(gaps).max(), jacobian[:, 1:]
        if not OPEN <= gap < ROUNDED:
            return bool(gap < OPEN)
        # A fully stretched chain cannot reduce its gap, either. Its followers are at a dead centre.
        reducible = followers @ np.linalg.pinv(followers) @ gaps
        return _determined(followers) and bool(np.abs(reducible).max() < OPEN)

    def fault(self, q: Array) -> str:
        """Reason why the master does not move the linkage at the positions q (n,); empty if the master moves it."""
        if not self.closes(q):
            return (
                f"no positions of its joints close the loop; a gap of {self.gap(q):.3g} m is left: give other `initial` "
                "positions"
            )
        if not _determined(self.equations(q)[1][:, 1:]):
            return (
                "does not determine the motion of the loop's joints at this position: it is a dead centre, or the loop has "
                "several degrees of freedom"
            )
        return ""

    @cached_property
    def trace(self) -> Trace:
        """Postures that the master reaches from the initial posture."""
        return Trace(self)

    def follow(self, positions: Array) -> Array:
        """Positions (..., n) in which the followers follow the master; the given positions of followers are ignored."""
        return self.close(self.trace.guess(positions))


def _determined(followers: Array) -> bool:
    """Whether the derivatives (r, k) of the gaps by the followers determine the motion of all followers."""
    values = np.linalg.svd(followers, compute_uv=False)
    return len(values) == followers.shape[1] and bool(values[-1] >= DEAD * values[0])


class Trace:
    """Postures of a linkage from its initial posture to the limit of a joint, or to a dead centre, in both directions. A master
    that turns freely is traced for a turn.

    Attributes:
        low, high: Range of the master in which no joint is beyond its limits, rad or m.
        dead: Whether each end of the range is a dead centre, which the master cannot pass.
        gap: Largest gap in the range, m. It remains due to rounding of the file's numbers.
        ignored: Joints that are beyond their limits in the initial posture. These limits are ignored.
    """

    def __init__(self, linkage: Linkage) -> None:
        self._linkage, start, stops = linkage, linkage.start, linkage.stops
        master = linkage.master
        low, high = stops[master]
        others = linkage.joints[1:]
        self.ignored = tuple(j for j in others if not stops[j, 0] - SLACK <= start[j] <= stops[j, 1] + SLACK)
        self._limited = [j for j in others if j not in self.ignored and np.isfinite(stops[j]).any()]
        self._turn: Array | None = None
        """Change of all positions in a turn of the master; None: the master does not turn freely."""
        rows, ends, dead = [start], [low, high], [False, False]
        for side, sign in enumerate((-1.0, 1.0)):
            found, ends[side], dead[side] = self._walk(sign, float(stops[master, side]))
            rows = [*reversed(found), *rows] if side == 0 else [*rows, *found]
            if self._turn is not None:
                ends = [-math.inf, math.inf]
                break
        self.low, self.high = ends
        self.dead = dead[0], dead[1]
        self._rows = np.array(rows)
        self.gap = float(np.abs(linkage.equations(self._rows)[0]).max())

    def _walk(self, sign: float, limit: float) -> tuple[list[Array], float, bool]:
        """Postures in one direction, the end of the range, and whether it is a dead centre."""
        own, master, rows = self._linkage, self._linkage.master, [self._linkage.start]
        joints, angles = list(own.joints), ~own.slides[list(own.joints)]
        if sign * (limit - rows[0][master]) <= 0.0:
            return [], limit, False
        stride, rates = math.inf, own.ratios(rows[0])
        while len(rows) < POSTURES:
            here = rows[-1]
            fastest = max(
                float(np.abs(rates[angles]).max(initial=0.0)), float(np.abs(rates[~angles]).max(initial=0.0)) / own.size
            )
            stride = min(2.0 * stride, STRIDE / max(fastest, 1e-300))
            ahead, next_row = math.inf, here
            while stride > SHORTEST * STRIDE / max(fastest, 1.0) and stride > 1e-12:
                ahead = min(here[master] + sign * stride, limit) if sign > 0 else max(here[master] - stride, limit)
                guess = here.copy()
                guess[joints] += rates * (ahead - here[master])
                guess[master] = ahead
                next_row = own.close(guess)
                jump = float(np.abs(next_row - guess)[joints].max())
                if own.closes(next_row) and jump < 0.5 * STRIDE * max(1.0, own.size):
                    break
                stride *= 0.5
            else:
                # The range ends here. It ends at a dead centre if the loops are still closed, and without a dead centre if the
                # gap has grown.
                return rows[1:], float(here[master]), own.gap(here) <= GROWN
            slopes = own.ratios(next_row)
            hit = self._hit(here, next_row, rates, slopes)
            if hit is not None:
                return [*rows[1:], hit], float(hit[master]), False
            rows.append(next_row)
            rates = slopes
            if next_row[master] == limit:
                return rows[1:], limit, False
            turned = abs(next_row[master] - rows[0][master])
            if angles[0] and not math.isfinite(limit) and turned >= math.tau:
                full = rows[0].copy()
                full[joints] = next_row[joints] - rates * sign * (turned - math.tau)
                full[master] = rows[0][master] + sign * math.tau
                full = own.close(full)
                change = sign * (full - rows[0])
                wound = np.abs(change - math.tau * np.round(change / math.tau))[joints]
                if (wound < 1e-6).all() and not any(abs(change[j]) > 1e-6 for j in self._limited):
                    self._turn = change
                    return rows[1:], math.inf * sign, False
        return rows[1:], float(rows[-1][master]), False

    def _hit(self, here: Array, there: Array, rates: Array, slopes: Array) -> Array | None:
        """First posture between two neighbouring postures at which a follower reaches its limit; None if no follower does.
        rates, slopes: ratios at the two postures.
        """
        own, master = self._linkage, self._linkage.master
        if not self._limited:
            return None
        candidates = [there]
        for j in self._limited:
            k = own.joints.index(j)
            # A follower that reverses between the two postures may exceed its limit there.
            if rates[k] * slopes[k] < 0.0:
                candidates.append(self._between(here, there, rates[k] / (rates[k] - slopes[k])))
        beyond = [row for row in candidates if self._excess(row) > 0.0]
        if not beyond:
            return None
        a, b = here, min(beyond, key=lambda row: abs(row[master] - here[master]))
        for _ in range(80):
            middle = self._between(a, b, 0.5)
            if not min(a[master], b[master]) < middle[master] < max(a[master], b[master]):
                break
            a, b = (a, middle) if self._excess(middle) > 0.0 else (middle, b)
        return a

    def _between(self, here: Array, there: Array, share: float) -> Array:
        return self._linkage.close(here + share * (there - here))

    def _excess(self, q: Array) -> float:
        """Largest distance of a follower beyond its limit, rad or m; negative within all limits."""
        low, high = self._linkage.stops[self._limited].T
        return float(np.maximum(low - q[self._limited], q[self._limited] - high).max()) - SLACK * 1e-3

    def guess(self, positions: Array) -> Array:
        """Positions (..., n) whose followers are near positions that close the linkage."""
        own, rows = self._linkage, self._rows
        z, master = positions[..., own.master], own.master
        turns = np.zeros_like(z)
        if self._turn is not None:
            turns = np.floor((z - rows[0, master]) / math.tau)
        place = z - math.tau * turns
        found = positions.copy()
        for j in own.joints[1:]:
            found[..., j] = np.interp(place, rows[:, master], rows[:, j])
            if self._turn is not None:
                found[..., j] += turns * self._turn[j]
        return found


# -- loops of a robot --------------------------------------------------------------------------------------------------


def linkages_of(robot: Robot) -> tuple[Linkage, ...]:
    """Linkages of the robot, from the initial positions of its joints. Raises RobotError for loops that no joint can close."""
    if not robot.loops:
        return ()
    return _linkages(robot.loops, robot.joints, tuple(block.joint for block in robot.actuators))


@lru_cache(maxsize=64)
def _linkages(loops: tuple[Loop, ...], joints: tuple[Joint, ...], driven: tuple[str, ...]) -> tuple[Linkage, ...]:
    above, moving = {joint.child: joint for joint in joints}, [joint for joint in joints if joint.moves]
    order = {joint.name: j for j, joint in enumerate(moving)}
    paths, problems = [], []
    for number, loop in enumerate(loops):
        path, fault = _path(loop, above, order)
        names = [moving[j].name for j in path.joints] if path else []
        if fault:
            problems.append(Problem(fault, key=f"loops.{number}", code="loop"))
        elif loop.master and loop.master not in names:
            message = f"its master '{loop.master}' is not a joint of the loop"
            problems.append(Problem(message, key=f"loops.{number}", choices=tuple(names), code="loop"))
        elif path:
            paths.append(path)
    if problems:
        raise RobotError(problems)
    stops, slides = np.array([joint.stops for joint in moving]), np.array([joint.kind == "prismatic" for joint in moving])
    stated = np.array([joint.start or 0.0 for joint in moving])
    found = []
    for members in _groups(paths, moving, order):
        inside = [number for number, path in enumerate(paths) if path.joints[0] in members]
        masters = {loops[number].master for number in inside if loops[number].master}
        if len(masters) > 1:
            message = f"has two masters, {' and '.join(sorted(masters))}: loops that share joints must have the same master"
            raise RobotError(message, key=f"loops.{inside[0]}", code="loop")
        names = [moving[j].name for number in inside for j in paths[number].joints]
        own = next((name for name in names if name in driven), names[0])
        master = order[next(iter(masters), own)]
        ties = tuple(
            MimicJoint(follower=j, leader=order[moving[j].mimic], ratio=moving[j].multiplier, offset=moving[j].offset)
            for j in sorted(members)
            if moving[j].mimic
        )
        lengths = [float(np.linalg.norm(one)) for number in inside for one in (*paths[number].origins, paths[number].ends)]
        linkage = Linkage(
            joints=(master, *sorted(members - {master})),
            loops=tuple(inside),
            paths=tuple(paths[k] for k in inside),
            ties=ties,
            size=max(lengths) or 1.0,
            start=stated,
            stops=stops,
            slides=slides,
        )
        found.append(replace(linkage, start=linkage.close(stated)))
    return tuple(found)


def _path(loop: Loop, above: dict[str, Joint], order: dict[str, int]) -> tuple[LoopPath | None, str]:
    """Path between the links of a loop; or None, and the reason."""
    chains = [_upwards(above, link) for link in loop.links]
    while chains[0] and chains[1] and chains[0][0] is chains[1][0]:
        chains = [chain[1:] for chain in chains]
    sides, ends = [], []
    for chain, point in zip(chains, loop.points, strict=True):
        side, pose = [], HERE
        for joint in chain:
            pose = pose.then(joint.origin, joint.rpy)
            if joint.moves:
                side.append((joint, pose))
                pose = HERE
        sides.append(side)
        ends.append(pose.position + pose.rotation @ point)
    members = [*sides[0], *sides[1]]
    if len(members) < 2:
        return None, "no joints lie between its links, so no motion can close it"
    path = LoopPath(
        joints=tuple(order[joint.name] for joint, _ in members),
        split=len(sides[0]),
        slides=tuple(joint.kind == "prismatic" for joint, _ in members),
        origins=tuple(pose.position for _, pose in members),
        turns=tuple(pose.rotation for _, pose in members),
        axes=tuple(np.array(joint.axis) for joint, _ in members),
        ends=np.concatenate(ends),
    )
    return path, ""


def _upwards(above: dict[str, Joint], link: str) -> Sequence[Joint]:
    """Joints from the root to a link."""
    found: list[Joint] = []
    while link in above:
        found.insert(0, above[link])
        link = above[link].parent
    return found


def _groups(paths: Sequence[LoopPath], moving: Sequence[Joint], order: dict[str, int]) -> Iterator[set[int]]:
    """Joints of each linkage: the joints of loops that share joints, and the joints coupled to them."""
    looped = {j for path in paths for j in path.joints}
    ties = [{j, order[joint.mimic]} for j, joint in enumerate(moving) if joint.mimic]
    groups: list[set[int]] = []
    waiting = [*(set(path.joints) for path in paths), *ties]
    for new in waiting:
        joined = [group for group in groups if group & new]
        groups = [group for group in groups if not group & new] + [new.union(*joined)]
    yield from sorted((group for group in groups if group & looped), key=min)


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """Linkages of a robot in their initial postures."""

    linkages: tuple[Linkage, ...] = ()
    """Linkages that their masters can move."""
    errors: tuple[Problem, ...] = ()
    warnings: tuple[Problem, ...] = ()


def assembly_of(robot: Robot, stated: Sequence[str] = ()) -> Assembly:
    """Linkages of a robot at initial positions that close them.

    If the joints' initial positions do not nearly close a loop, or close it at a dead centre, the loop starts at the nearest
    closed posture that is found, unless one of the `stated` joints belongs to the loop.
    """
    return _assembly(robot.loops, robot.joints, tuple(block.joint for block in robot.actuators), tuple(stated))


@lru_cache(maxsize=64)
def _assembly(loops: tuple[Loop, ...], joints: tuple[Joint, ...], driven: tuple[str, ...], stated: tuple[str, ...]) -> Assembly:
    try:
        linkages = _linkages(loops, joints, driven) if loops else ()
    except RobotError as error:
        return Assembly(errors=error.problems)
    moving, errors, warnings, kept = [joint for joint in joints if joint.moves], list[Problem](), list[Problem](), []
    for linkage in linkages:
        names = [moving[j].name for j in linkage.joints]
        if linkage.fault(linkage.start) and not set(names) & set(stated):
            linkage = replace(linkage, start=_nearest(linkage, np.array([joint.start or 0.0 for joint in moving])))
            if not linkage.fault(linkage.start):
                places = ", ".join(f"{moving[j].name}: {linkage.start[j]:.4g}" for j in linkage.joints)
                message = "the chain is open or at a dead centre at the default positions: it starts in another posture"
                hint = "State other positions under `initial` in the scenario"
                warnings.append(Problem(message, key=names[0], value=places, hint=hint, code="loop-start"))
        if fault := linkage.fault(linkage.start):
            subject = "" if fault.startswith("no positions") else f"joint '{names[0]}' "
            errors.append(Problem(subject + fault, key=f"loops.{linkage.loops[0]}", code="loop"))
        else:
            kept.append(linkage)
    return Assembly(linkages=tuple(kept), errors=tuple(errors), warnings=tuple(warnings))


def assembled(robot: Robot, assembly: Assembly) -> tuple[Robot, list[Problem]]:
    """Robot whose joints start where the loops are closed, and whose masters stop where a follower reaches its limit; and
    warnings about the loops.
    """
    moving, warnings = robot.moving_joints, [*assembly.warnings]
    changed: dict[str, Joint] = {}
    for linkage in assembly.linkages:
        master, trace = moving[linkage.master], linkage.trace
        changed |= {moving[j].name: replace(moving[j], start=float(linkage.start[j])) for j in linkage.joints}
        low, high = (
            stated if dead or not math.isfinite(end) else end
            for stated, dead, end in zip((master.lower, master.upper), trace.dead, (trace.low, trace.high), strict=True)
        )
        changed[master.name] = replace(changed[master.name], lower=low, upper=high)
        if trace.gap >= OPEN:
            message = "the chain does not close exactly: the gap is taken to be rounding of the file's numbers"
            if trace.gap > GROWN:
                message += "; the joint stops where the gap would be larger"
            warnings.append(Problem(message, key=master.name, value=f"up to {1e3 * trace.gap:.2g} mm", code="loop-gap"))
        for j in trace.ignored:
            message = "starts outside its limits, at the position that its loop requires: these limits are not enforced"
            warnings.append(Problem(message, key=moving[j].name, value=f"{linkage.start[j]:.4g}", code="loop-limits"))
        for end, dead in zip((trace.low, trace.high), trace.dead, strict=True):
            if dead:
                message = (
                    "brings its loop to a dead centre at this position: a run that moves the joint to it ends with an error"
                )
                hint = f"Another master may pass this dead centre: {listed([moving[j].name for j in linkage.joints[1:]], 5)}"
                warnings.append(Problem(message, key=master.name, value=f"{end:.4g}", hint=hint, code="dead-centre"))
    joints = tuple(changed.get(joint.name, joint) for joint in robot.joints)
    return replace(robot, joints=joints), warnings


def _nearest(linkage: Linkage, stated: Array) -> Array:
    """Closed posture near the stated positions; the stated positions if no closed posture is found."""
    generator, joints = np.random.default_rng(0), list(linkage.joints)
    reach = np.where(linkage.slides, linkage.size, np.pi)
    low, high = np.maximum(linkage.stops[:, 0], -reach), np.minimum(linkage.stops[:, 1], reach)
    best, least, count = stated, math.inf, 0
    for trial in range(TRIALS):
        guess = stated.copy()
        if trial:
            guess[joints] = generator.uniform(low, np.maximum(low, high))[joints]
        found = linkage.close(guess, first=0)
        within = (linkage.stops[joints, 0] - SLACK <= found[joints]) & (found[joints] <= linkage.stops[joints, 1] + SLACK)
        away = float(np.abs(found - stated)[joints].sum()) + 100.0 * float((~within).sum())
        if not linkage.fault(found):
            count += 1
            if away < least:
                best, least = found, away
            if count == ENOUGH:
                break
    return best


def closed(linkages: Sequence[Linkage], positions: ArrayLike) -> Array:
    """Positions (..., n) in which the followers of all linkages follow their masters."""
    q = np.asarray(positions, dtype=float)
    for linkage in linkages:
        q = linkage.follow(q)
    return q
