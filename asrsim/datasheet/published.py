"""Published values of actuators, with their sources. Values for which no source was found are left out on purpose."""

from __future__ import annotations

from asrsim.datasheet.data import Published

QB_MANUAL = "qbrobotics, qbmove Advanced Kit user manual, 28 April 2021, section 3.2.2"
AWAS_II_2014 = "Jafari, Tsagarakis, Sardellitti, Caldwell (2014), IEEE/ASME Trans. Mechatronics 19(1), 55-63, abstract"
PARNENZINI = (
    "Parnenzini, Simulation of a variable stiffness actuator in Gazebo, table I and section IV "
    "(qbmove_project.pdf in github.com/nickparnenzini/qbmove_plugin)"
)
QB_ROS = "qbrobotics, ROS-qbmove, qb_move_description/config/default.yaml"
QB_FIRMWARE = "qbrobotics, firmware of the qbmove Maker Pro 6.1.0, commands.h"
EDINBURGH = (
    "Howard (2010), libmaccepa, University of Edinburgh, which cites Van Ham et al. (2007), Robotics and Autonomous Systems "
    "55, 761-768, for the law"
)
PAPER = "Mengacci et al. (2021), section 4.1 and figure 8"
FRIEDL_2011 = "Friedl, Hoeppner, Petit, Hirzinger (2011), Wrist and forearm rotation of the DLR Hand Arm System, IROS, abstract"
VAN_HAM_2006 = "Van Ham, Vanderborght, Verrelst, Van Damme, Lefeber (2006), MACCEPA, abstract"
CJT = "Malzahn, Roozing (2016), Compliant Joint Toolbox (github.com/geez0x1/CompliantJointToolbox), param/"
RICHI = "Mengacci, advanced_plugin.cpp in github.com/Richi90/ROS-Gazebo-plugin-qbmove, after the maker's data sheet"
PETIT_2010 = "Petit, Chalon, Friedl, Grebenstein, Albu-Schaeffer, Hirzinger (2010), ICRA, abstract"
NONE = "No available source states its numbers, so nothing is compared."

PUBLISHED: dict[str, tuple[Published, ...]] = {
    "sea": (
        Published(
            key="stiffness_max", source=PAPER, text="200 and 400 N m/rad, for the Walk-Man SEA of figure 8",
            why="the toolbox's default is 10 N m/rad; the example dof1_sea states 200 and 400 as the paper",
        ),
        Published(
            key="stiffness_max", source=f"{CJT}WMBig10k_ds.m, WMBig2300_ds.m, WMBig10k.m",
            text="torsion bars of Walk-Man's big motor: 10000 and 2300 N m/rad by data sheet, 12823 N m/rad identified",
            why="this is the spring of a leg; the default spring of the toolbox suits a desk-top joint",
        ),
        Published(
            key="peak_torque", source=f"{CJT}WMBig10k_ds.m",
            text="40 A x 0.0453 N m/A x 100 = 181 N m, of the same motor; 40 A is also the continuous current",
            why="a sheet with these constants in its tags has 181.2 N m; the toolbox's default is 6 N m",
        ),
        Published(
            key="top_speed", source=f"{CJT}WMBig10k_ds.m", text="5.86 rad/s at 24 V",
            why=
                "with these constants, a sheet has 24 V / (100 x 0.0453 V s/rad) = 5.3 rad/s, below the limit in the source; "
                "the default is the limit of 6 rad/s in the toolbox",
        ),
        Published(
            key="voltage", source=f"{CJT}WMBig10k_ds.m", text="24 V, 0.0885 ohm, gear 100", why="<mot_voltMax> would state it"
        ),
        Published(key="current", source=f"{CJT}WMBig10k_ds.m", text="40 A", why="<mot_currMax> would state it"),
    ),
    "qbmove": (
        Published(
            key="stiffness_max", source=QB_MANUAL,
            text="a_1 = 8.9995, a_2 = 8.9989 1/rad, k_1 = 0.0026, k_2 = 0.0011 N m: 3.69 N m/rad at preset 0.6 rad",
            why="the toolbox has 8.9992 1/rad and 0.0019 N m for both springs (3.78 N m/rad, 2.6 % more); the maker's springs "
            "differ from each other, so that the unloaded equilibrium is off the middle",
        ),
        Published(
            key="stiffness_min", text="the same law at preset 0: 0.0333 N m/rad", source=QB_MANUAL,
            why="0.0342 with the toolbox's numbers",
        ),
        Published(
            key="stiffness_max", source=PARNENZINI,
            text="an earlier qbmove has k = 0.022 N m, a = 6.85 1/rad: 9.2 N m/rad at preset 0.6 rad, 0.30 at preset 0",
            why="the same law, k sinh(a d) for each motor, with other springs",
        ),
        Published(
            key="stiffness_max", source=RICHI,
            text="k = 0.0222 N m, a = 6.7328 1/rad: 8.49 N m/rad at preset 0.6 rad, 0.299 at preset 0; 4.85 N m at 0.8 rad",
            why="springs of the data sheet before the Advanced Kit: stiffer at rest, less progressive (exponent 6.7, not 9)",
        ),
        Published(
            key="top_speed", text="3.75 rad/s, measured as rise over time of a step without load", source=PARNENZINI,
            why=
                "this is a mean over the rise, for another motor (friction 0.8 N m, inertia 1 g m^2); 6 rad/s is the limit "
                "in the toolbox",
        ),
        Published(
            key="change_loaded", text="its change of stiffness was measured at a nominal torque of 1.5 N m", source=PARNENZINI,
            why="the toolbox states no nominal torque: the sheet loads the joint by 20 % of the torque that every setting "
            "holds; the published times are only drawn in a figure",
        ),
        Published(
            key="rotation", text="5.752 rad (limits of the shaft, -2.876 to 2.876 rad)", source=QB_ROS,
            why="the file of the toolbox states no limits; mot_1_minPos and similar tags would state limits",
        ),
        Published(
            key="resolution", text="16 bits over a selectable range of 360 to 92160 degrees; finest resolution: 9.6e-5 rad",
            source=QB_FIRMWARE,
            why="sensors belong to scenarios: `quantum: 9.6e-5` states it",
        ),
    ),
    "bavs": (
        Published(
            key="peak_torque", source=FRIEDL_2011, text="both motors may drive the joint in one direction (drive redundancy)",
            why="this also holds in the sheet; no available source states torque and stiffness",
        ),
        Published(
            key="peak_torque", source=PETIT_2010,
            text="a helping mode, in which both motors pull in one direction, increases the load range, without pretension",
            why="the sheet's largest torque is at preset 0, where both springs pull in one direction",
        ),
    ),
    "awas_ii": (
        Published(
            key="stiffness_max", text="the stiffness ranges from zero to infinity", source=AWAS_II_2014,
            why=
                "this also holds for the law, for sigma from 0 to L; the sheet covers 0.005 to 0.04 m, as figure 8 of the "
                "paper",
        ),
    ),
    "maccepa": (
        Published(
            key="deflection_soft", source=VAN_HAM_2006, text="torque nearly linear in the angle, and in the pretension",
            why="the first chart shows this; numbers depend on the lengths, which asrsim has chosen",
        ),
        Published(
            key="stiffness_loaded", source=EDINBURGH,
            text="-0.6579 to 0.4154 N m/rad over all deflections of a joint with k = 323 N/m, B = 0.03 m, drum 7.5 mm",
            why=
                "the law of asrsim gives -0.6579 and 0.4155 with C = 0.13 m, which the source does not state; the spring "
                "of the sheet was chosen by asrsim",
        ),
    ),
    "awas": (Published(key="", text=NONE, source="Jafari et al. (2010)", why="the law is published; asrsim chose numbers"),),
    "quadratic_cam": (
        Published(key="", text=NONE, source="Migliore et al. (2005)", why="the law is published; asrsim chose numbers"),
    ),
}  # fmt: skip
"""Publications by the name of the actuator."""
