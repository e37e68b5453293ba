"""A swing on a linear spring whose rest jumps between two samples of the recorded command, computed exactly."""

import numpy as np

from support.identify_files import SEA, save, write

STIFFNESS, DAMPING, INERTIA = 4.0, 0.02, 0.009
"""N m/rad, N m s/rad, kg m^2."""
TAGS = "<spring_k>5</spring_k><max_def>2</max_def>"
"""A guessed stiffness, and a limit of the deflection (rad) that the swing never reaches."""
JUMPS = (0.3, 0.9, 1.6, 2.2, 2.9, 3.5)
"""Times of the first samples after the jumps, s."""


def swing(folder, seed, rate=100.0, noise=5e-4):
    """Scenario with other numbers, recording of 4 s, and how much earlier each jump was, s: up to a sample."""
    random, time = np.random.default_rng(seed), np.arange(round(4.0 * rate) + 1) / rate
    first = np.round(np.array(JUMPS) * rate).astype(int)
    levels = np.append(0.0, random.uniform(0.1, 0.4, len(first)) * np.where(np.arange(len(first)) % 2, -1.0, 1.0))
    early = random.uniform(0.0, 1.0 / rate, len(first))
    values, vectors = np.linalg.eig(np.array([[0.0, 1.0], [-STIFFNESS / INERTIA, -DAMPING / INERTIA]]))
    inverse = np.linalg.inv(vectors)
    place = 0.0 * time
    for at, change in zip(time[first] - early, np.diff(levels), strict=True):
        after = np.maximum(time - at, 0.0)
        # The response of the position to a step of the spring's rest.
        free = np.real((vectors[0] * np.exp(np.outer(after, values))) @ inverse[:, 0])
        place += change * (1.0 - free)
    shown = levels[np.searchsorted(first, np.arange(len(time)), side="right")]
    noisy = place + noise * random.normal(size=len(time))
    header = "time [s],joint_1.reference_1 [rad],joint_1.link_position [rad]"
    recording = save(folder / "a.csv", header, time, shown, noisy)
    lab = write(folder, "lab", {**SEA, "mode": 2, "damping": 0.04, "tags": TAGS}, duration=4.0)
    lab.write_text(f"{lab.read_text()}substeps: 2\n")
    return lab, recording, early
