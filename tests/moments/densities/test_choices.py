"""Every density of a study file, and the keys that are not its own."""

from pathlib import Path

import pytest
from pydantic_core import PydanticCustomError

from aleator.moments.densities import Gaussian, GaussianMixture, MaximumEntropy
from aleator.study.sections import DENSITIES


@pytest.mark.parametrize(
    ("section", "choice"),
    [
        ({"kind": "maximum_entropy"}, MaximumEntropy()),
        ({"kind": "maximum_entropy", "order": 6}, MaximumEntropy(6)),
        ({"kind": "gaussian"}, Gaussian()),
        ({"kind": "gaussian_mixture"}, GaussianMixture()),
        ({"kind": "automatic"}, None),
        ({}, None),
    ],
)
def test_the_study_file_names_every_density(section: dict, choice: object) -> None:
    assert DENSITIES.read(section).build(Path()) == choice


@pytest.mark.parametrize(
    ("kind", "key", "owner"),
    [
        ("gaussian", "order", "maximum_entropy"),
        ("gaussian_mixture", "order", "maximum_entropy"),
    ],
)
def test_a_key_of_another_density_is_refused(kind: str, key: str, owner: str) -> None:
    with pytest.raises(PydanticCustomError) as refused:
        DENSITIES.read({"kind": kind, key: 5})
    assert refused.value.context["key"] == key
    assert f'kind = "{owner}"' in refused.value.context["remedy"]
    assert DENSITIES.read({"kind": owner, key: 5}).kind == owner
