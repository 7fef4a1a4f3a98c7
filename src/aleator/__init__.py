"""Aleator identifies the probability law of uncertain parameters from experiments."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aleator.errors import AleatorError as AleatorError
    from aleator.inference.check import Check as Check
    from aleator.inference.outcome_question import OutcomeQuestion as OutcomeQuestion
    from aleator.laws import Beta as Beta
    from aleator.laws import Between as Between
    from aleator.laws import By as By
    from aleator.laws import Constant as Constant
    from aleator.laws import Free as Free
    from aleator.laws import Gamma as Gamma
    from aleator.laws import LogNormal as LogNormal
    from aleator.laws import Mixture as Mixture
    from aleator.laws import Normal as Normal
    from aleator.laws import ScipyLaw as ScipyLaw
    from aleator.laws import TruncatedNormal as TruncatedNormal
    from aleator.laws import Uniform as Uniform
    from aleator.laws.correlation import full as full
    from aleator.laws.inputs import Inputs as Inputs
    from aleator.laws.quadrature import MonteCarloPoints as MonteCarloPoints
    from aleator.laws.quadrature import ProbabilityGrid as ProbabilityGrid
    from aleator.laws.quadrature import Smolyak as Smolyak
    from aleator.laws.quadrature import SobolPoints as SobolPoints
    from aleator.laws.quadrature import TensorGauss as TensorGauss
    from aleator.moments.densities import Gaussian as Gaussian
    from aleator.moments.distances import earth_movers_distance as earth_movers_distance
    from aleator.moments.expansion import Hyperbolic as Hyperbolic
    from aleator.moments.expansion import TotalDegree as TotalDegree
    from aleator.moments.expansion import sobol_indices as sobol_indices
    from aleator.moments.maximum_entropy import MaximumEntropy as MaximumEntropy
    from aleator.moments.projection import Projection as Projection
    from aleator.moments.projection import Regression as Regression
    from aleator.moments.propagation import Collocation as Collocation
    from aleator.observations.correlated import AR1 as AR1
    from aleator.observations.correlated import CAR1 as CAR1
    from aleator.observations.correlated import CompoundSymmetry as CompoundSymmetry
    from aleator.observations.experiments import Conditions as Conditions
    from aleator.observations.experiments import Experiments as Experiments
    from aleator.observations.model import StudentError as StudentError
    from aleator.observations.noise import Noise as Noise
    from aleator.observations.outcomes import Censoring as Censoring
    from aleator.observations.state_space import GaussianProcess as GaussianProcess
    from aleator.observations.variance import ExponentialVariance as ExponentialVariance
    from aleator.observations.variance import PowerVariance as PowerVariance
    from aleator.search import CMAES as CMAES
    from aleator.search import CustomSearch as CustomSearch
    from aleator.search import DifferentialEvolution as DifferentialEvolution
    from aleator.search import GeneticAlgorithm as GeneticAlgorithm
    from aleator.search import GradientMultistart as GradientMultistart
    from aleator.simulators import Budget as Budget
    from aleator.simulators import Runner as Runner
    from aleator.simulators import Store as Store
    from aleator.simulators.command import CommandSimulator as CommandSimulator
    from aleator.simulators.derived import derived as derived
    from aleator.simulators.fmu import FMUSimulator as FMUSimulator
    from aleator.simulators.umbridge import UMBridgeSimulator as UMBridgeSimulator
    from aleator.surrogates import ResponseSurface as ResponseSurface
    from aleator.tasks.bootstrap import bootstrap as bootstrap
    from aleator.tasks.box import feasible_box as feasible_box
    from aleator.tasks.ceiling import ceiling as ceiling
    from aleator.tasks.compare import compare as compare
    from aleator.tasks.identification import Identification as Identification
    from aleator.tasks.identification import load as load
    from aleator.tasks.identify import identify as identify
    from aleator.tasks.next_experiment import Predicted as Predicted
    from aleator.tasks.next_experiment import next_experiments as next_experiments
    from aleator.tasks.p_box import PBox as PBox
    from aleator.tasks.p_box import p_box as p_box
    from aleator.tasks.posterior import Posterior as Posterior
    from aleator.tasks.posterior import posterior as posterior
    from aleator.tasks.predict import predict as predict
    from aleator.tasks.recover import recover as recover
    from aleator.tasks.screen import screen as screen
    from aleator.views.progress import ProgressLine as ProgressLine

# A public name is imported when it is first used: `import aleator` itself costs nothing.
_HOMES = {
    "tasks.identify": ["identify"],
    "tasks.identification": ["Identification", "load"],
    "tasks.predict": ["predict"],
    "tasks.p_box": ["p_box", "PBox"],
    "tasks.posterior": ["posterior", "Posterior"],
    "tasks.recover": ["recover"],
    "tasks.next_experiment": ["next_experiments", "Predicted"],
    "tasks.screen": ["screen"],
    "tasks.compare": ["compare"],
    "tasks.bootstrap": ["bootstrap"],
    "tasks.box": ["feasible_box"],
    "tasks.ceiling": ["ceiling"],
    "observations.experiments": ["Experiments", "Conditions"],
    "observations.outcomes": ["Censoring"],
    "observations.noise": ["Noise"],
    "observations.correlated": ["AR1", "CAR1", "CompoundSymmetry"],
    "observations.state_space": ["GaussianProcess"],
    "observations.variance": ["PowerVariance", "ExponentialVariance"],
    "observations.model": ["StudentError"],
    "simulators": ["Runner", "Store", "Budget"],
    "simulators.command": ["CommandSimulator"],
    "simulators.derived": ["derived"],
    "simulators.fmu": ["FMUSimulator"],
    "simulators.umbridge": ["UMBridgeSimulator"],
    "laws": [
        "Normal", "TruncatedNormal", "Uniform", "Beta", "Gamma", "LogNormal", "Mixture", "ScipyLaw",
        "Between", "By", "Constant", "Free",
    ],
    "laws.correlation": ["full"],
    "laws.inputs": ["Inputs"],
    "surrogates": ["ResponseSurface"],
    "moments.propagation": ["Collocation"],
    "laws.quadrature": [
        "TensorGauss", "Smolyak", "SobolPoints", "MonteCarloPoints", "ProbabilityGrid",
    ],
    "moments.projection": ["Projection", "Regression"],
    "moments.expansion": ["TotalDegree", "Hyperbolic", "sobol_indices"],
    "moments.maximum_entropy": ["MaximumEntropy"],
    "moments.densities": ["Gaussian"],
    "moments.distances": ["earth_movers_distance"],
    "search": [
        "GradientMultistart", "GeneticAlgorithm", "DifferentialEvolution", "CMAES", "CustomSearch",
    ],
    "inference.check": ["Check"],
    "inference.outcome_question": ["OutcomeQuestion"],
    "views.progress": ["ProgressLine"],
    "errors": ["AleatorError"],
}  # fmt: skip

# What is looked for in `identify` or a law, and is an argument of another class.
_TAKEN_BY = {"correlation": "Inputs", "levels": "Inputs", "relative": "Noise", "sd": "Noise"}

__all__ = [name for names in _HOMES.values() for name in names]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import the module of a public name, and keep the name here from then on."""
        home = next((home for home, names in _HOMES.items() if name in names), None)
        if home is None:
            raise AttributeError(f"module 'aleator' has no attribute '{name}'")
        module = import_module(f"aleator.{home}")
        found = getattr(module, name)
        if callable(found) and name != "AleatorError":
            found = import_module("aleator.errors").naming_arguments(found, _TAKEN_BY)
            setattr(module, name, found)  # so that it can be pickled by its name
        return globals().setdefault(name, found)

    def __dir__() -> list[str]:
        """The public names, imported or not, for completion in an editor."""
        return sorted({*globals(), *__all__})
