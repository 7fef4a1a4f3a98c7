"""Every figure and table of the paper that Aleator reproduces, in the paper's order."""

from __future__ import annotations

from collections.abc import Sequence

from aleator.errors import AleatorError, nearest
from reproduction.clutch.accuracy import distances, likelihoods
from reproduction.clutch.density import density_16
from reproduction.clutch.distributions import distributions, identification
from reproduction.clutch.engagement import feedforward, position, pressure, speed, torque
from reproduction.clutch.measured import measured
from reproduction.clutch.response import clipped, response
from reproduction.clutch.samples import accuracy, needed
from reproduction.figure import Figure
from reproduction.illustrative.coefficients import coefficients
from reproduction.illustrative.densities import matching
from reproduction.illustrative.moments import moments
from reproduction.illustrative.transform import transform
from reproduction.index_sets import offline, sets
from reproduction.searches import searches

FIGURES = (
    Figure("sets", "Multi-indices of the exact moments of an expansion", "Fig. 2", sets),
    Figure("offline-time", "Time of the offline step for each (n, d, m)", "Fig. 3", offline),
    Figure(
        "illustrative-transform",
        "A normal parameter through the illustrative simulator",
        "Fig. 4",
        transform,
    ),
    Figure(
        "illustrative-coefficients",
        "Coefficients of the expansion for each quadrature order q",
        "Fig. 5a",
        coefficients,
    ),
    Figure(
        "illustrative-moments",
        "Discrepancy of the moments from the true ones",
        "Fig. 5b",
        moments,
    ),
    Figure(
        "illustrative-densities",
        "Densities that match the moments of the illustrative outcome",
        "Fig. 6",
        matching,
    ),
    Figure(
        "clutch-feedforward",
        "Feed-forward current of the valve, experiment 16",
        "Fig. 8",
        feedforward,
    ),
    Figure("clutch-pressure", "Overpressure in an engagement, experiment 16", "Fig. 10a", pressure),
    Figure("clutch-position", "Position of the piston, experiment 16", "Fig. 10b", position),
    Figure("clutch-torque", "Torques of an engagement, experiment 16", "Fig. 11a", torque),
    Figure("clutch-speed", "Speeds of an engagement, experiment 16", "Fig. 11b", speed),
    Figure(
        "clutch-measured",
        "SYNTHETIC measurements against the deterministic simulation",
        "Fig. 13",
        measured,
    ),
    Figure(
        "clutch-response-16",
        "Simulated shifting time of experiment 16",
        "Fig. 14, top left",
        response,
    ),
    Figure("clutch-clipped", "Clipped joint law of both parameters", "Fig. 14, top right", clipped),
    Figure(
        "clutch-distributions",
        "Distributions of all experiments at alpha = (1, 1, 0.07, 0.02)",
        "Fig. 14, bottom",
        distributions,
    ),
    Figure(
        "clutch-density-16",
        "Densities of experiment 16 at alpha = (1, 1, 0.07, 0.02)",
        "Fig. 15",
        density_16,
    ),
    Figure(
        "clutch-identification",
        "The law identified with Gaussian and with maximum-entropy densities",
        "Figs. 16, 17",
        identification,
    ),
    Figure(
        "clutch-likelihoods",
        "Log-likelihood of each experiment, estimated and reference",
        "Fig. 18",
        likelihoods,
    ),
    Figure("clutch-emd", "Earth mover's distance to the reference", "Fig. 19", distances),
    Figure(
        "clutch-accuracy",
        "Error of the log-densities against the number of samples",
        "Fig. 20",
        accuracy,
    ),
    Figure("samples-needed", "Samples that are as exact as 25 runs", "Table 2", needed),
    Figure(
        "searches",
        "Searches for the clutch's law, by maximum entropy",
        "sec. results, no figure",
        searches,
    ),
)


def chosen(names: Sequence[str]) -> tuple[Figure, ...]:
    """The figures of these names in the paper's order, all of them without a name.

    Raises AleatorError for an unknown name.

    >>> [figure.place for figure in chosen(["illustrative-coefficients"])]
    ['Fig. 5a']
    """
    known = [figure.name for figure in FIGURES]
    for name in names:
        if name not in known:
            raise AleatorError(
                f"the paper has no figure '{name}' here{nearest(name, known)}",
                f"choose from {', '.join(known)}",
            )
    return tuple(figure for figure in FIGURES if not names or figure.name in names)
