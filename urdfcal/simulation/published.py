"""What the paper prints: its Tables I to VII, and what it says of Fig. 4, whose curves are a picture.

Lengths in mm, angles in deg, distances as mean, standard deviation and largest.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

Figures = tuple[float, float, float]  # mean, std, max [mm]
SpotFigures = tuple[Figures, Figures]  # of l1 and l2
Before = Mapping[tuple[int, str], SpotFigures]  # by case, and `fit` or `test`
After = Mapping[tuple[str, int, str], SpotFigures]  # by estimator, too


class NominalRow(NamedTuple):
    """One line of Table I or IV, [mm] and [deg]; theta is what the table adds to the joint's reading, low and high are its range."""

    name: str
    a: float
    d: float
    alpha: float
    theta: float
    low: float
    high: float


TABLE_I = (
    NominalRow("1", -500, 0, -90, -90, -180, 90),
    NominalRow("2", 0, 100, -90, 90, -10, 90),
    NominalRow("3", 0, 0, -90, -90, -10, 30),
    NominalRow("4", 0, 200, 90, 0, -120, 0),
    NominalRow("5", 0, 0, -90, 0, -90, 90),
    NominalRow("6", 0, 200, 90, 90, -30, 30),
    NominalRow("7", 0, 0, 90, 0, -30, 30),
    NominalRow("SLM", 50, 0, 0, 180, 0, 0),
)
TABLE_II: Before = {
    (1, "fit"): ((84.06, 4.54, 96.03), (15.94, 6.83, 29.11)),
    (1, "test"): ((89.16, 20.48, 154.18), (29.73, 19.63, 85.49)),
    (2, "fit"): ((84.34, 15.62, 154.18), (27.07, 18.70, 85.49)),
    (2, "test"): ((88.88, 14.10, 143.93), (18.59, 11.89, 55.34)),
    (3, "fit"): ((86.61, 15.05, 154.18), (22.83, 16.24, 85.49)),
}
TABLE_III: After = {
    ("LSE", 1, "fit"): ((0.42, 0.14, 0.79), (0.32, 0.13, 0.62)),
    ("LSE", 1, "test"): ((0.77, 0.52, 2.19), (0.82, 0.57, 2.98)),
    ("LSE", 2, "fit"): ((0.18, 0.13, 0.49), (0.15, 0.10, 0.53)),
    ("LSE", 2, "test"): ((0.22, 0.19, 0.81), (0.20, 0.17, 0.72)),
    ("LSE", 3, "fit"): ((0.15, 0.10, 0.47), (0.12, 0.09, 0.44)),
    ("EKF", 1, "fit"): ((0.12, 0.04, 0.23), (0.08, 0.04, 0.16)),
    ("EKF", 1, "test"): ((0.27, 0.14, 0.69), (0.29, 0.13, 0.65)),
    ("EKF", 2, "fit"): ((0.09, 0.05, 0.26), (0.09, 0.06, 0.25)),
    ("EKF", 2, "test"): ((0.09, 0.06, 0.27), (0.09, 0.06, 0.28)),
    ("EKF", 3, "fit"): ((0.10, 0.06, 0.29), (0.08, 0.06, 0.23)),
}
FIG_4_SWEEPS, FIG_4_NORM = 100, 0.01  # "the norm value of 33 parameters [...] was less than 0.01 within 100 iterations"
TABLE_IV = (
    NominalRow("1", -365, 690, 0, -90, -30, 30),
    NominalRow("2", 0, -30, -90, 90, -20, 20),
    NominalRow("3", 0, 0, -90, 0, -90, 45),
    NominalRow("4", 100, 0, 0, 180, -60, 90),
    NominalRow("SLM", -30, 0, -90, 0, 0, 0),
)
# (da, dd, dalpha, dtheta) of joints 1 to 4, then Trans x, Trans z, Rot x, Rot y, Rot z of the module; by case
TABLE_V: Mapping[int, tuple[float, ...]] = {
    1: (
        *(-0.0653, 0.7499, 0.0859, 0.1042, 0.0567, -0.6759, -0.1337, -0.0141),
        *(0.0724, 0.0047, 0.1233, -1.9234, -0.1235, -0.3415, -0.0222, 2.3708),
        *(0.0194, 0.3703, 0.0644, 0.5829, 0.0156),
    ),
    2: (
        *(-0.0453, 0.0788, -0.4756, -0.0844, -0.0463, -0.0411, -0.1155, 0.0087),
        *(0.0355, -0.0004, -0.0779, 0.9971, -0.0497, -0.0100, 0.0382, -0.0319),
        *(-0.0093, 0.0004, -0.0155, 0.0135, 0.0273),
    ),
    3: (
        *(-0.0088, 0.0028, -0.3953, -0.0688, -0.0359, -0.0047, -0.0972, 0.0115),
        *(0.0346, -0.0002, -0.0682, 0.9217, -0.0418, -0.0037, 0.0373, -0.0317),
        *(-0.0050, 0.0065, -0.0118, 0.0184, 0.0219),
    ),
}
TABLE_VI: Before = {
    (1, "fit"): ((7.09, 0.79, 8.72), (8.18, 1.74, 13.38)),
    (1, "test"): ((8.43, 3.62, 21.61), (10.00, 5.30, 23.73)),
    (2, "fit"): ((8.07, 3.53, 21.61), (9.19, 3.97, 20.17)),
    (2, "test"): ((7.40, 1.20, 9.76), (8.92, 3.99, 23.73)),
    (3, "fit"): ((7.74, 2.66, 21.61), (9.06, 3.98, 23.73)),
}
TABLE_VII: After = {
    ("EKF", 1, "fit"): ((0.85, 0.37, 1.52), (0.87, 0.64, 2.42)),
    ("EKF", 1, "test"): ((2.62, 2.96, 12.04), (6.19, 4.60, 16.26)),
    ("EKF", 2, "fit"): ((1.44, 0.81, 3.42), (2.85, 2.27, 8.95)),
    ("EKF", 2, "test"): ((1.23, 0.45, 2.22), (2.11, 1.92, 8.67)),
    ("EKF", 3, "fit"): ((1.10, 0.61, 2.89), (1.95, 1.89, 9.57)),
}
