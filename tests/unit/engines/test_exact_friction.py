"""Changes of velocity in a step, compared with NumPy's solution of the same equations."""

from types import SimpleNamespace

import numpy as np
import pytest

from asrsim.engines.exact_friction import AT_LOWER, AT_UPPER, POSITIVE, solve_states
from asrsim.engines.rigid import make_room
from asrsim.robot.couplings import Couplings


def tree_of(parent, source):
    """Positive definite matrix, with zeros where neither of two degrees of freedom carries the other."""
    size = len(parent)
    factor = np.eye(size)
    for i, k in enumerate(parent):
        while k >= 0:
            factor[i, k] = source.normal()
            k = parent[k]
    return factor.T @ np.diag(source.uniform(0.5, 2.0, size)) @ factor


@pytest.mark.parametrize("size", [1, 7, 40])
@pytest.mark.parametrize("branches", [1, 4])
def test_changes_on_a_tree_solve_its_equations(size, branches):
    """One room, also used by a run that diverged, for several steps with other states of friction and stops; damping is added
    to the diagonal."""
    source = np.random.default_rng(size)
    parent = np.array([max(i - source.integers(1, branches + 1), -1) for i in range(size)])
    jointless = SimpleNamespace(
        moving_joints=(), couplings=Couplings(master=np.zeros(0, np.int64), ratio=np.zeros(0), offset=np.zeros(0))
    )
    room = make_room(jointless, qpos=np.zeros(size), qvel=np.zeros(size), joint_q=[], joint_v=[], free=False, parent=parent)
    room.square[:] = np.nan
    for states in ([POSITIVE], range(AT_LOWER, AT_UPPER + 1), [POSITIVE]):
        room.matrix[:] = tree_of(parent, source)
        room.diagonal[:] = room.matrix.diagonal() + source.uniform(0.0, 1.0, size)
        room.impulse[:], room.velocity[:] = source.normal(size=(2, size))
        room.bound[:], room.slowest[:], room.fastest[:] = source.uniform(0.1, 1.0, (3, size)) * [[1.0], [-1.0], [1.0]]
        room.regime[:] = source.choice(states, size)
        solve_states(room)
        whole = room.matrix + np.diag(room.diagonal - room.matrix.diagonal())
        slides = abs(room.regime) == POSITIVE
        goals = np.where(room.regime == AT_LOWER, room.slowest, np.where(room.regime == AT_UPPER, room.fastest, 0.0))
        expected = goals - room.velocity
        forces = room.impulse - room.regime * room.bound - whole[:, ~slides] @ expected[~slides]
        expected[slides] = np.linalg.solve(whole[np.ix_(slides, slides)], forces[slides])
        assert room.change == pytest.approx(expected, rel=1e-9, abs=1e-9)
        needed = whole @ expected - room.impulse
        assert room.push[~slides] == pytest.approx(needed[~slides], rel=1e-9, abs=1e-8)
