"""An UM-Bridge server for tests: springs, of which some fail, and a level at three times."""

import sys
from typing import Any

Vectors = list[list[float]]


def serve(port: int) -> None:
    """Serve the models at a port of this machine until the process ends."""
    import umbridge

    class Evaluated(umbridge.Model):  # type: ignore[misc]
        def supports_evaluate(self) -> bool:
            return True

    class Spring(Evaluated):
        """Travel, and travel with energy; load and stiffness are one vector."""

        def get_input_sizes(self, _: dict[str, Any]) -> list[int]:
            return [2]

        def get_output_sizes(self, _: dict[str, Any]) -> list[int]:
            return [1, 2]

        def __call__(self, parameters: Vectors, config: dict[str, Any]) -> Vectors:
            load, stiffness = parameters[0]
            if stiffness > 50.0:
                raise ValueError("too stiff")
            if stiffness > 40.0:
                return [[float("nan")], [0.0, 0.0]]
            travel = config.get("factor", 1.0) * load / stiffness
            return [[travel], [travel, 0.5 * load * travel]]

    class Decay(Evaluated):
        """The level at three times; the rate is one vector, the times are another."""

        def get_input_sizes(self, _: dict[str, Any]) -> list[int]:
            return [1, 3]

        def get_output_sizes(self, _: dict[str, Any]) -> list[int]:
            return [3]

        def __call__(self, parameters: Vectors, _: dict[str, Any]) -> Vectors:
            (rate,), times = parameters
            return [[1.0 / (1.0 + rate * time) for time in times]]

    umbridge.serve_models([Spring("spring"), Decay("decay")], port, max_workers=2)


if __name__ == "__main__":
    serve(int(sys.argv[1]))
