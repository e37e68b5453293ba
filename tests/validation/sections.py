"""All checks with explanations, in the order of docs/validation.md."""

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
            "The plugin classes of the released toolbox were driven step by step with prescribed motions of the link and "
            "references, including saturation, position limits, static friction and integral action. The recorded outputs "
            "of these classes are compared with the outputs of asrsim's test bench with toolbox stepping."
        ),
        measures=(released.oracle,),
        engines=False,
        needs="data",
    ),
    Section(
        title="Closed forms",
        text=(
            "Simulations are compared with solutions in closed form. If the true frequency is omega, a leapfrog simulation "
            "with step h oscillates at 2 / h asin(omega h / 2). Simulated frequencies are compared with this value, so only "
            "rounding errors remain. The load is the paper's load (section 4.1): 0.2 kg at 0.04 m from a horizontal axis."
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
            closed_forms.impacts,
        ),
    ),
    Section(
        title="Contacts",
        text=(
            "By default, PyBullet stops its contact solver after 50 iterations, or at a residual of 1e-7. Boxes and joints "
            "that should stick then creep (by 0.15 mm/s and 1 mrad/s in these tests). asrsim stops the solver after 500 "
            "iterations, or at a residual of 1e-18; most steps need fewer iterations. Contacts in MuJoCo are springs with a "
            "time constant of several steps. Bodies at rest neither sink nor creep. A box that slides fast sometimes loses "
            "contact, so its friction is correct only on average. The logged contact force is the force on the first body of"
            " the pair in the last substep before the sample. In every step, the sum of all forces on a body equals its mass"
            " times its acceleration (`tests/physics/test_contact_worlds.py`)."
        ),
        measures=(
            contacts.sliding,
            contacts.stopping,
            contacts.resting,
            contacts.landing,
        ),
        slow=frozenset({"stopping"}),
        solvers=True,
    ),
    Section(
        title="Energy and momentum",
        text=(
            "Without losses, the energy oscillates by at most (omega h)^2 / 4 and does not drift. Momentum is constant "
            "except for rounding errors. Without input, no run gains energy. With toolbox stepping, runs in modes 5 and 6 "
            "gain energy, as in the released code."
        ),
        measures=(conservation.energy_and_momentum, conservation.long_swings, conservation.passivity),
        slow=frozenset({"long_swings"}),
    ),
    Section(
        title="Order of convergence",
        text=(
            "Random robots at default settings are compared with an independent solution. It consists of Pinocchio's "
            "dynamics, and of separate implementations of the paper's laws of springs, motors and controllers; DOP853 "
            "integrates these equations to 1e-11. The order in the time step is two, also if inputs jump at a step or "
            "between steps. The order of a single robot may be lower, because a torque that reaches its limit within a step "
            "adds an error that depends on the phase of the step. With dry friction of joints and Dahl friction of motors, "
            "the order is also two, because a step is split where the velocity of a link becomes 0. If torques push a link "
            "back while it strikes its stop, the link leaves the stop at the time of the impact. The error of this motion is "
            "of second order (`tests/physics/test_joint_stops.py`). In an arm with several joints, velocity torques are "
            "constant within the step of an impact, so the order may be one. With delayed, sampled, noisy and quantised "
            "commands and measurements, the order is two (`tests/physics/test_sensors.py`). For 16 sensors with random rates"
            " of 90 to 900 Hz and delays of .1 to 6 ms, the error is 3e-6 to 1.1e-5 rad at 1 ms. The order that is computed "
            "from a number of substeps and twice this number is .7 to 2.7, since the phases of the sensors' sampling times "
            "within a substep then differ. From 1 to 16 substeps, the median order is 2.000. With contacts, the engines' own"
            " solvers compute friction, and the order is one."
        ),
        measures=(order.smooth, order.first_order_schemes, order.friction_orders, order.impacts),
        slow=frozenset({"smooth", "first_order_schemes", "friction_orders"}),
        needs="pinocchio",
    ),
    Section(
        title="Independent dynamics",
        text=(
            "The mass matrix, gravity torques and velocity torques of the engines are obtained from single steps. They are "
            "compared with Pinocchio's matrices and torques at 20 random states of each robot."
        ),
        measures=(dynamics.rigid_body,),
        needs="pinocchio",
    ),
    Section(
        title="The paper's step responses (figure 8)",
        text=(
            "The eight joints of the paper are simulated at asrsim's default settings, without friction and limits. Their "
            "link positions are compared with a Runge-Kutta solution with steps of 1e-5 s. The bound is a thirtieth of the "
            "error of real Gazebo with the same time step."
        ),
        measures=(independent.step_responses,),
        needs="data",
    ),
    Section(
        title="The error of a run",
        text=(
            "`asrsim run --certify` estimates the error of a run by Richardson's method, from runs at a half and a quarter "
            "of the step. The number in the table is the ratio of this estimate to the true error, or the inverse ratio if "
            "it is larger, for the eight joints of figure 8. The law of a spring has a corner at its deflection limit. When "
            "a deflection passes this limit, the order of the error is temporarily lower (AwAS-II at .04 m, BAVS)."
        ),
        measures=(independent.certificates,),
        slow=frozenset({"certificates"}),
        needs="data",
    ),
    Section(
        title="Real Gazebo, with friction and limits",
        text=(
            "The recorded runs of Gazebo differ from asrsim's runs by up to 2e-2 rad (RMS over 5 s), which is the error "
            "that Gazebo's time step causes. With dry friction, links also come to rest at different positions: a link may "
            "rest at any position at which the torques of spring and weight differ by less than the friction. AwAS-II at .04"
            " m is unstable in Gazebo."
        ),
        measures=(independent.gazebo,),
        needs="data",
    ),
)
