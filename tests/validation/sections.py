"""All checks in the order of the document, with what there is to know about them."""

from __future__ import annotations

from validation import (
    closed_forms,
    conservation,
    contacts,
    dynamics,
    independent,
    order,
    released,
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
            "Without losses energy swings by (omega h)^2 / 4 at most and never drifts; momentum is kept to rounding. Without "
            "input no run gains energy; the released code's order of a step does, in modes 5 and 6."
        ),
        measures=(conservation.energy_and_momentum, conservation.long_swings, conservation.passivity),
        slow=frozenset({"long_swings"}),
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
        measures=(order.smooth, order.jumps, order.first_order_schemes, order.friction_orders),
        slow=frozenset({"smooth", "jumps", "first_order_schemes", "friction_orders"}),
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
        measures=(independent.step_responses,),
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
            "Gazebo's recorded runs differ from ours by up to 2e-2 rad (RMS over 5 s), which is Gazebo's own step error "
            "(semi-implicit Euler in maximal coordinates, first order) and, under dry friction, the place where the last swing "
            "happens to end: a link may rest wherever spring and weight differ by less than the friction. AwAS-II at .04 m is "
            "unstable in Gazebo."
        ),
        measures=(independent.gazebo,),
        needs="data",
    ),
)
