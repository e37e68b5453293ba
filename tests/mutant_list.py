"""The changes that :mod:`mutants` tries: file, line, what it becomes, and the tests that are likeliest to notice."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """One wrong change."""

    file: str
    """Below the package."""
    old: str
    """Stands in it once."""
    new: str
    tests: tuple[str, ...]
    """Names of test files."""


def changed(file: str, old: str, new: str, *tests: str) -> Mutant:
    """A change, in a line."""
    return Mutant(file, old, new, tests)


MUTANTS = (
    changed("simulation/splits.py", "/ (2.0 * length), 1.0)", "/ length, 1.0)", "core_truth", "random_robots", "energy"),
    changed("simulation/certify.py", "1.0 / (1.0 - 4.0**-used)", "1.0 / (1.0 - 2.0**-used)", "core_small"),
    changed("simulation/inputs.py", "start, end = (first - 0.5) * h, (first", "start, end = first * h, (first", "core_seams"),
    changed(
        "simulation/spring_meter.py",
        "        middle = 0.5 * (q[:, :-1] + q[:, 1:])",
        "        middle = q[:, :-1]",
        "energy",
        "truth",
    ),
    changed("simulation/spring_meter.py", "near[:, :1] |= begun[i]", "near[:, :1] |= False", "core_seams"),
    changed("simulation/toolbox.py", "state[0] + i * error * step", "state[0] + i * error", "core_seams"),
    changed("simulation/wrenches.py", "max((first - 0.5) * substep, 0.0)", "first * substep", "core_seams"),
    changed("simulation/effects.py", "end - effects.delay) + effects.delay", "end - effects.delay)", "core_seams"),
    changed("simulation/bench.py", "torque -= drive.link_brake * v", "torque += drive.link_brake * v", "core_seams"),
    changed("simulation/damping.py", "(fastest - 1.0 - RINGING)", "(fastest - RINGING)", "damping"),
    changed("simulation/divergence.py", " - float(residual.sum())", "", "core_seams"),
    changed("simulation/kernels.py", "y = y + after * u_y", "y = y + after * v_y", "core_truth", "random_robots", "facts"),
    changed("simulation/stretches.py", "where[0] += first - start", "where[0] += first", "core_seams"),
    changed("simulation/recording.py", "energy is not None and not scenario.wrenches", "energy is not None", "core_seams"),
    changed("simulation/substeps.py", "motor_substeps += 1 - motor_substeps % 2", "motor_substeps += 0", "core_seams"),
    changed(
        "actuators/rest.py",
        "return min(max(rest, low), high)",
        "return rest",
        "core_seams",
    ),
    changed("simulation/observation.py", "position + lag * velocity, velocity", "position, velocity", "core_seams"),
    changed("simulation/flows.py", "abs(raw[MOTOR_1, j, k] - q),", "raw[MOTOR_1, j, k] - q,", "core_seams"),
    changed(
        "robot/poses.py",
        "cr * cp * sy - sr * sp * cy",
        "cr * cp * sy + sr * sp * cy",
        "two_engines",
        "core_truth",
        "random_robots",
    ),
    changed("engines/bullet_model.py", "energy -= mass * sum", "energy += mass * sum", "energy", "divergence", "two_engines"),
    changed("engines/mujoco.py", "return 0.5 * float(v @", "return 1.0 * float(v @", "core_seams"),
    changed("engines/exact_friction.py", "STOP_SHARE = 0.2", "STOP_SHARE = 0.3", "two_engines", "core_truth"),
    changed(
        "engines/mujoco_stages.py",
        "world.wrench_turn[index, column, axis] * world.wrench[index, 3 * kind + axis]",
        "world.wrench_turn[index, axis, column] * world.wrench[index, 3 * kind + axis]",
        "two_engines",
        "truth",
    ),
    changed(
        "engines/bullet_companion.py",
        "whole = np.array(self.forces(states, forces)) * fraction",
        "whole = np.array(self.forces(states, forces))",
        "core_truth",
        "random_robots",
    ),
    changed("engines/contact_forces.py", '(f"{second}/{first}", -1.0)', '(f"{second}/{first}", 1.0)', "two_engines", "truth"),
    changed("engines/bullet_companion.py", "2.0 * self._start - now", "self._start - now", "core_truth", "random_robots"),
    changed(
        "engines/mujoco_model.py",
        "data.xpos[body] + rotation @ (offset + turn @",
        "data.xpos[body] + rotation @ (turn @",
        "random_robots",
    ),
    changed("actuators/bavs.py", "- a * exp(-k_e * s_1)) * (d_1 - s_1)", "+ a * exp(-k_e * s_1)) * (d_1 - s_1)", "actuators"),
    changed("actuators/motor.py", "0.5 * (velocity + after), anchor", "after, anchor", "energy", "truth"),
    changed("actuators/vectorised.py", "total += weight * torque_1 * d_1", "total += torque_1 * d_1", "core_seams"),
    changed(
        "robot/step_checks.py",
        '2.0 * parameters["motor_2_max_torque"] if',
        'parameters["motor_2_max_torque"] if',
        "robot_physics",
        "robot_sanity",
    ),
    changed("robot/inertia.py", "(link.mass or 0.0) * linear.T", "linear.T", "robot_physics", "robot_sanity", "robot_files"),
    changed("robot/merge.py", "away = place - centre", "away = place", "robot_physics", "mounting", "random_robots"),
    changed(
        "robot/structure.py",
        "upper = None if upper is not None and math.isinf(upper) else upper",
        "upper = upper",
        "robot_files",
    ),
    changed("robot/sanity.py", "DEGREES[0] < abs(bound)", "DEGREES[0] < bound", "robot_sanity"),
    changed(
        "robot/poses.py",
        "s * rotation[0, 2] - c * rotation[1, 2], c",
        "s * rotation[0, 2] + c * rotation[1, 2], c",
        "robot_engine_text",
    ),
    changed(
        "learning/linear.py",
        "np.clip(motors - position[:, None], -most, most)",
        "motors - position[:, None]",
        "learning_linear",
    ),
    changed("learning/law.py", "run[-1] < CREEP * run[0]", "run[-1] < run[0]", "learning"),
    changed("learning/perturb.py", "waiting += fixed", "waiting += []", "learning_plant"),
    changed("learning/contraction.py", "max(growing[0] - 1, 0)", "growing[0]", "learning_linear"),
    changed("learning/playback.py", "round(ceil(value *", "round(floor(value *", "learning", "ilc_command"),
    changed(
        "learning/identify.py",
        "1.0 - cost(there, trial_x) / cost(left, x)",
        "cost(there, trial_x) / cost(left, x)",
        "learning_auto",
    ),
    changed(
        "learning/optimal.py", "len(trials) - 1 - stalled <= patience", "len(trials) - stalled <= patience", "learning_auto"
    ),
    changed("learning/transfer.py", "(count - 3)", "count", "learning_transfer"),
    changed("metrics/periodic.py", "1.5 * float(np.sum(apart", "15.0 * float(np.sum(apart", "frequency"),
    changed("metrics/oscillation.py", "x[i - 1] / (x[i - 1] - x[i]) * (", "0.5 * (", "metrics"),
    changed("metrics/spectra.py", "(1 + 2 * (1 - 1 / windows)", "(1 + 0 * (1 - 1 / windows)", "frequency"),
    changed("metrics/excitation.py", "* inner and outer <", "* inner or outer <", "frequency"),
    changed("metrics/motion.py", "values[:, :3] - values[0, :3], axis", "values[:, :3], axis", "metrics"),
    changed("recordings/join.py", "(raw.epoch or 0.0) - zero", "(raw.epoch or 0.0)", "recordings_csv"),
    changed("recordings/read_csv.py", "< 0.02 * abs(mark)", "< 2.0 * abs(mark)", "recordings_csv"),
    changed("recordings/align.py", "TRUSTED = 0.6", "TRUSTED = 0.3", "recordings_compare"),
    changed("recordings/bag_clock.py", "_SAME_CLOCK = 1.0", "_SAME_CLOCK = 1e4", "recordings_bags"),
    changed("recordings/clock.py", "_moves(found[1]) and _moves", "_moves(found[1]) or _moves", "recordings_compare"),
    changed("log/columns.py", 'view(offset, "u1") == Opcode.MESSAGE', 'view(offset, "u1") > 0', "log_damage"),
    changed("log/derived.py", "if meaning.mapped or not meaning.spring:", "if meaning.mapped:", "log_derived"),
    changed("log/cdr.py", "-(len(self._data) - 4) % size", "-len(self._data) % size", "log_readers"),
    changed("scenario/check.py", "abs(steps - round(steps)) > 1e-6", "abs(steps - round(steps)) > 0.4", "semantics"),
    changed("scenario/signal_doubts.py", "np.linspace(end, 100.0 * end, 2001)", "np.linspace(end, end, 2001)", "robot_sanity"),
    changed("signals/combine.py", "self.of.jumps(start - self.by - 1e-6", "self.of.jumps(start", "signals"),
    changed("signals/common.py", "time + SLACK", "time", "signals", "signals_playback"),
    changed("signals/pulse_train.py", "min(last, self.count - 1)", "min(last, self.count)", "signals"),
    changed(
        "robot/model.py",
        "math.inf if self.upper is None else self.upper",
        "math.inf if self.upper is None else -self.upper",
        "learning_auto",
    ),
    changed("kinematics/drive_forward.py", "middle[i] + half * rates[i]", "middle[i] + step * rates[i]", "learning_linear"),
    changed(
        "kinematics/clik.py", "error[:3] = wanted[index] - position", "error[:3] = wanted[index - 1] - position", "kinematics"
    ),
    changed("kinematics/holding.py", "np.any(np.abs(torques) > self._limits", "np.any(torques > self._limits", "sizing"),
    changed("kinematics/reach.py", "-ORIENTATION_WEIGHT * between", "ORIENTATION_WEIGHT * between", "kinematics"),
    changed("kinematics/drive_inverse.py", "np.where(torque >= 0.0, most, least)", "most", "learning_auto"),
    changed("plots/world.py", 'if other != "ground"', 'if other == "ground"', "plots_experiment", "plots"),
    changed("plots/curves.py", '(part, joints) + part.values["link', '(part, joints) - part.values["link', "plots"),
    changed("plots/decimate.py", "if gone.any():", "if False:", "plots_decimate"),
    changed("simulation/substep.py", "goals[READINGS + 2 * i + 1]", "goals[READINGS + 1]", "core_seams"),
    changed(
        "simulation/flows.py",
        "(rest - 0.5 * (q + q_after))",
        "(rest - q)",
        "energy",
        "core_small",
    ),
    changed(
        "engines/exact_friction.py",
        "change[dof] = world.target[world.pick[a]] - world.qvel[dof]",
        "change[dof] = -world.qvel[dof]",
        "core_seams",
    ),
    changed("actuators/qbmove.py", "* (d_2 - s_2)", "* (d_1 - s_1)", "actuators"),
    changed(
        "robot/inertia.py",
        "if not link.mass and link.inertia is None",
        "if not link.mass or link.inertia is None",
        "robot_physics",
        "robot_files",
    ),
    changed("learning/transfer.py", "< 2 * len(names) + 2", "< len(names)", "learning_transfer"),
    changed("metrics/step.py", "low: float = 0.1, high", "low: float = 0.2, high", "metrics"),
    changed("recordings/oddities.py", "edges[1::2] - 1", "edges[1::2]", "recordings_csv", "recordings_field"),
    changed("log/description.py", 'run["log_every"] < 1', 'run["log_every"] < 0', "log_damage", "edited_files"),
    changed(
        "scenario/starter_motion.py",
        "start = min(max(0.0, low + margin), high - margin)",
        "start = max(0.0, low + margin)",
        "init",
    ),
    changed(
        "kinematics/compensation.py",
        "math.copysign(math.inf, equilibrium - position)",
        "math.copysign(math.inf, position - equilibrium)",
        "kinematics_compensation",
    ),
    changed(
        "kinematics/drive_forward.py",
        "rates[i], 0.0, sums[i], wanted[i]",
        "rates[i], 0.0, 0.0, wanted[i]",
        "learning_linear",
        "learning_auto",
    ),
    changed("plots/curves.py", "min(self._end, last)", "last", "plots", "plots_experiment"),
)
