"""What publications say about actuators, with the source. Values that no source at hand states are missing here on purpose."""

from __future__ import annotations

from asrsim.datasheet.data import Published

QB_MANUAL = "qbrobotics, qbmove Advanced Kit user manual, 28 April 2021, section 3.2.2"
AWAS_II_2014 = "Jafari, Tsagarakis, Sardellitti, Caldwell (2014), IEEE/ASME Trans. Mechatronics 19(1), 55-63, abstract"
PAPER = "Mengacci et al. (2021), section 4.1 and figure 8"
FRIEDL_2011 = "Friedl, Hoeppner, Petit, Hirzinger (2011), Wrist and forearm rotation of the DLR Hand Arm System, IROS, abstract"
VAN_HAM_2006 = "Van Ham, Vanderborght, Verrelst, Van Damme, Lefeber (2006), MACCEPA, abstract"
NONE = "No source at hand states its numbers: the sheet stands alone."

PUBLISHED: dict[str, tuple[Published, ...]] = {
    "sea": (Published(key="", text=NONE, source=PAPER, why="the paper takes a Walk-Man SEA and prints no data of it"),),
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
    ),
    "bavs": (
        Published(
            key="peak_torque", source=FRIEDL_2011, text="both motors may drive the joint in one direction (drive redundancy)",
            why="so does the sheet; numbers of torque and stiffness were not found in a source at hand",
        ),
    ),
    "awas_ii": (
        Published(
            key="stiffness_max", text="the stiffness ranges from zero to infinity", source=AWAS_II_2014,
            why="so does the law, for sigma from 0 to L; the sheet goes from 0.005 to 0.04 m, as the paper's figure 8",
        ),
    ),
    "maccepa": (
        Published(
            key="deflection_soft", source=VAN_HAM_2006, text="torque nearly linear in the angle, and in the pretension",
            why="the first chart shows it; numbers depend on the lengths, which are ours",
        ),
    ),
    "awas": (Published(key="", text=NONE, source="Jafari et al. (2010)", why="the law is theirs, the numbers are ours"),),
    "quadratic_cam": (
        Published(key="", text=NONE, source="Migliore et al. (2005)", why="the law is theirs, the numbers are ours"),
    ),
}  # fmt: skip
"""Publications by the name of the actuator."""
