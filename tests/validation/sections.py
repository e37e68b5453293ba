"""All checks in the order of the document, with what there is to know about them."""

from __future__ import annotations

from validation import (
    closed_forms,
    conservation,
    contacts,
    dynamics,
    gazebo,
    independent,
    order,
    released,
    repeatability,
    stability,
)
from validation.check import Section

SECTIONS: tuple[Section, ...] = (
    Section(
        title="The released code",
        text=(
            "Outputs of the released toolbox's own plugin classes, driven step by step with prescribed link motion and "
            "references (saturations, position limits, friction stick, integral action), against the test bench in toolbox "
            "stepping."
        ),
        measures=(released.oracle,),
        engines=False,
        needs="data",
    ),
    Section(
        title="Closed forms",
        text=(
            "What mechanics gives on paper. Frequencies are held against the scheme's own: a leapfrog of step h swings at "
            "2 / h asin(omega h / 2) for a true omega, so its error is known in advance, and what is left here is "
            "rounding. The load is the paper's (section 4.1): 0.2 kg at 0.04 m from a horizontal axis."
        ),
        measures=(
            closed_forms.static_equilibrium,
            closed_forms.motor_droop,
            closed_forms.oscillation_frequency,
            closed_forms.two_mass_frequency,
            closed_forms.modal,
            closed_forms.pendulum_period,
            closed_forms.coulomb_friction,
            closed_forms.terminal_velocity,
        ),
    ),
    Section(
        title="Contacts and wrenches",
        text=(
            "PyBullet stops its contact solver at 50 iterations or a residual of 1e-7; boxes and joints that should stick "
            "then creep (by 0.15 mm/s and 1 mrad/s in these tests). asrsim lets it go on to 500 iterations or 1e-18, "
            "which most steps do not need. MuJoCo's contacts are springs of some steps: nothing sinks or creeps that rests, "
            "but a box that slides fast loses touch now and then, and friction works on average only. Forces of a contact are "
            "those on the first body in the last substep of a row; they are the body's mass times its acceleration in every "
            "step (`tests/physics/test_contact_worlds.py`)."
        ),
        measures=(
            contacts.sliding,
            contacts.slip_threshold,
            contacts.stopping,
            contacts.resting,
            contacts.landing,
            contacts.link_wrench,
        ),
        slow=frozenset({"stopping"}),
    ),
    Section(
        title="Energy and momentum",
        text=(
            "Without losses energy swings by (omega h)^2 / 4 at most and never drifts; momentum is kept to rounding. The "
            "balance that each run logs (work of the motors, losses, energy of motors and springs, work on the link) "
            "closes to second order, across jumps of inputs too. Without input no run gains energy; the released code's "
            "order of a step does, in modes 5 and 6."
        ),
        measures=(conservation.energy_and_momentum, conservation.long_swings, conservation.balance, conservation.passivity),
        slow=frozenset({"long_swings", "balance"}),
    ),
    Section(
        title="Order of convergence",
        text=(
            "Largest error of the joint positions over 0.6 s at a step of 1 ms *without substeps*, and the order in which "
            "it falls, against an independent solution: Lagrange's equations of a planar chain with motors, controllers "
            "and springs, solved by DOP853 to 1e-11. Second order where forces are smooth: with many joints (the engine "
            "evaluates velocity torques half a step late, which is made up for), with motors (their half of the "
            "splitting), with damping, adjusters that move and inputs that jump, on a step or between two. Dry friction "
            "switches, and where in a step it does so is chance: first order for the joints' (the engine's); the motors' "
            "Dahl friction keeps the second."
        ),
        measures=(order.smooth, order.jumps, order.refined, order.first_order_schemes, order.friction_orders),
        slow=frozenset({"smooth", "jumps", "refined", "first_order_schemes", "friction_orders"}),
    ),
    Section(
        title="Independent dynamics",
        text=(
            "Mass matrix, gravity and velocity torques of the engines against Pinocchio, at 20 random states each; and a "
            "whole simulation of a swing in space against Pinocchio's forward dynamics integrated by DOP853. PyBullet's "
            "own transforms of vectors and quaternions are single precision, its inverse dynamics ignores the base's "
            "orientation: neither is used so."
        ),
        measures=(dynamics.rigid_body, dynamics.spatial_swing),
        needs="pinocchio",
    ),
    Section(
        title="The paper's step responses (figure 8)",
        text=(
            "Eight settings at default settings and a step of 1 ms, without friction and limits, against a Runge-Kutta "
            "solution at 1e-5 s. The bound is a thirtieth of what real Gazebo reached at the same step."
        ),
        measures=(independent.step_responses, independent.steady_states),
        slow=frozenset({"steady_states"}),
        needs="data",
    ),
    Section(
        title="The error of a run",
        text=(
            "What `asrsim run --certify` reports (Richardson's estimate from runs at a half and a quarter of the step) over "
            "the true error, for the same eight cases. Where deflections pass the spring's limit the law has a corner, and "
            "the order is lower for a while (AwAS-II at .04 m, BAVS)."
        ),
        measures=(independent.certificates,),
        slow=frozenset({"certificates"}),
        needs="data",
    ),
    Section(
        title="Real Gazebo, with friction and limits",
        text=(
            "Gazebo's recorded runs differ from ours by up to 2e-2 rad (RMS over 5 s), and every part of it is accounted "
            "for. What Gazebo 11 does was written down from the recordings (maximal coordinates, semi-implicit Euler, "
            "hinge with an error reduction of 0.2, explicit damping, rotation by quaternions, friction as a bounded "
            "torque, the velocity limit as a torque of zero above it): it gives the recorded numbers back to rounding, so "
            "nothing in them is unexplained. With a finer step the same model tends to asrsim's solution at the first "
            "order that semi-implicit Euler has. So the differences are, one by one: Gazebo's step error (first order: "
            "1e-3 to 2e-2 rad; AwAS-II at .04 m is unstable in it, omega h = 3.3); the resting place under dry friction, "
            "which only has to lie within tau_f / k, and in which the two differ by where the last swing happened to end; "
            "and the velocity limit: Gazebo zeroes the torque of a joint faster than 100 rad/s, asrsim's leapfrog reports that "
            "the limit was passed and goes on (SEA and AwAS-II at .04 m pass it). In toolbox stepping all recorded runs "
            "finish. There the two have the same order of a step, in the joint's coordinate here, in the body's six there; at "
            "1 ms that makes less than Gazebo is off itself, and at 20 us, where Gazebo's model resolves the springs, 1e-5 rad."
        ),
        measures=(
            gazebo.reproduction,
            gazebo.convergence,
            gazebo.velocity_limit,
            gazebo.toolbox_stepping,
            gazebo.resting_places,
        ),
        slow=frozenset({"convergence", "toolbox_stepping", "resting_places"}),
        needs="data",
    ),
    Section(
        title="Divergence",
        text=(
            "A spring that is not resolved shows in the energy: what it gives, and what it held, part ways. Over all that "
            "went through the joint, that share stays below 0.3 in every stable run, however coarse, and goes past 1 in "
            "an unstable one; asrsim stops at 0.5. Numbers that are not finite come later, or never: deflections "
            "saturate. Toolbox stepping, which has no substeps and runs what Gazebo ran, says so beforehand and goes on."
        ),
        measures=(stability.shares,),
        slow=frozenset({"shares"}),
    ),
    Section(
        title="Repeatability",
        text="Hashes of all numbers of a run, contacts included: in the same process, in fresh ones, plain and compiled.",
        measures=(repeatability.repeatability, repeatability.compiled),
        slow=frozenset({"repeatability", "compiled"}),
    ),
)
