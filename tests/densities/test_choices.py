"""Every density of a study file, and the keys that are not its own."""

import pytest
from pydantic import ValidationError

from aleator.densities import Convolution, Gaussian, GaussianMixture, LogSpline, MaximumEntropy
from aleator.study.sections import DensitySection


@pytest.mark.parametrize(
    ("section", "choice"),
    [
        (DensitySection(kind="maximum_entropy"), MaximumEntropy()),
        (DensitySection(kind="maximum_entropy", order=6), MaximumEntropy(6)),
        (DensitySection(kind="gaussian"), Gaussian()),
        (DensitySection(kind="gaussian_mixture"), GaussianMixture()),
        (DensitySection(kind="convolution", points=50), Convolution(50)),
        (DensitySection(kind="logspline", knots=12, smoothing=1e-3), LogSpline(12, smoothing=1e-3)),
    ],
)
def test_the_study_file_names_every_density(section: DensitySection, choice: object) -> None:
    assert section.build() == choice
    assert section.build().name


@pytest.mark.parametrize(
    ("kind", "key", "owner"),
    [
        ("gaussian", "order", "maximum_entropy"),
        ("convolution", "knots", "logspline"),
        ("logspline", "points", "convolution"),
        ("gaussian_mixture", "order", "maximum_entropy"),
    ],
)
def test_a_key_of_another_density_is_refused(kind: str, key: str, owner: str) -> None:
    with pytest.raises(ValidationError, match=f"{key} has no meaning"):
        DensitySection.model_validate({"kind": kind, key: 5})
    assert DensitySection.model_validate({"kind": owner, key: 5}).kind == owner


def test_defaults_of_the_file_are_those_of_the_library() -> None:
    defaults = DensitySection()
    assert MaximumEntropy().order == defaults.order
    assert Convolution().points == defaults.points
    assert LogSpline() == LogSpline(defaults.knots, smoothing=defaults.smoothing)
