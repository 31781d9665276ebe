"""Readings of the joints that are noisy: a covariance of each pose's numbers in place of columns."""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import DEG
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Answer
from urdfcal.estimation.score import Fitted

_SIGMAS = 0.005 * DEG * np.sqrt(2.0) ** np.arange(9)  # [rad]


def joint_noise(ground: Ground, fitted: Fitted) -> Answer:
    """All turning joints' readings off by one standard deviation, R_i = R + sigma^2 J_q J_q' of the numbers of a pose."""
    rows, m = ground.rows, ground.linearisation.residual.shape[1]
    reach = ground.own_turns.reshape(rows, m, -1)
    values, vectors = np.linalg.eigh(reach @ reach.transpose(0, 2, 1))
    turned = fitted.spread(vectors.transpose(0, 2, 1))  # in the axes in which that noise is independent
    tried = []
    for sigma in _SIGMAS.tolist():
        grown = 1 + sigma**2 * np.maximum(values, 0.0)
        evidence, total = turned.weighed(1 / np.sqrt(grown.ravel()))
        gain = evidence - 0.5 * float(np.sum(np.log(grown))) - fitted.log_evidence
        scale = np.sqrt(total / fitted.numbers)  # what is left of the sensor's own noise
        tried.append((gain, float(sigma * scale), grown, 1 - total / fitted.total, float(scale)))
    gain, sigma, grown, share, left = max(tried, key=lambda each: each[0])
    roots = (vectors / np.sqrt(grown)[:, None]) @ vectors.transpose(0, 2, 1)
    price = float(np.log(len(tried)))
    return Answer("joint_noise", "", gain - price, np.empty((rows * m, 0)), share=share, noise=roots, joint_sigma=sigma, left=left)
