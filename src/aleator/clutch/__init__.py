"""The wet clutch, Aleator's benchmark: a simulator, its experiments and a virtual test bench.

The model follows the structure that the paper gives for the shifting time of a wet clutch. Neither
the measurements nor most parameters of the paper are public, so **all numbers here are synthetic**:
in `aleator.clutch.parameters` every value carries its unit and either its source or the mark (i),
which means invented, and the measurements of `measure` come from an invented test bench.

- `shifting_time`: the simulator, vectorized over runs; `aleator.clutch:shifting_time` in a study
- `design`: the 108 experiments
- `measure`: synthetic measurements of them
- `trajectories`: every quantity of one engagement over time
"""

from aleator.clutch.bench import measure
from aleator.clutch.doe import design
from aleator.clutch.engagement import trajectories
from aleator.clutch.simulator import shifting_time

__all__ = ["shifting_time", "design", "measure", "trajectories"]
