"""An UM-Bridge server for tests: springs, a bar of several points, and a model that fails."""

import sys
from typing import Any

import umbridge


class Spring(umbridge.Model):  # type: ignore[misc]
    """Travel and energy of a spring: load and stiffness in one vector; a factor in the config."""

    def get_input_sizes(self, _: dict[str, Any]) -> list[int]:
        return [2]

    def get_output_sizes(self, _: dict[str, Any]) -> list[int]:
        return [1, 2]

    def __call__(self, parameters: list[list[float]], config: dict[str, Any]) -> list[list[float]]:
        load, stiffness = parameters[0]
        if stiffness > 50.0:
            raise ValueError("too stiff")
        if stiffness > 40.0:
            return [[float("nan")], [0.0, 0.0]]
        travel = config.get("factor", 1.0) * load / stiffness
        return [[travel], [travel, 0.5 * load * travel]]

    def supports_evaluate(self) -> bool:
        return True


class Decay(umbridge.Model):  # type: ignore[misc]
    """The level at three times: the rate is one vector, the times are another."""

    def get_input_sizes(self, _: dict[str, Any]) -> list[int]:
        return [1, 3]

    def get_output_sizes(self, _: dict[str, Any]) -> list[int]:
        return [3]

    def __call__(self, parameters: list[list[float]], _: dict[str, Any]) -> list[list[float]]:
        (rate,), times = parameters
        return [[1.0 / (1.0 + rate * time) for time in times]]

    def supports_evaluate(self) -> bool:
        return True


if __name__ == "__main__":
    umbridge.serve_models([Spring("spring"), Decay("decay")], int(sys.argv[1]), max_workers=2)
