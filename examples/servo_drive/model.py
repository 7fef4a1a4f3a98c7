"""A servo drive with backlash: what is left of a commanded motion at the load."""

import numpy as np


def travel(command, torque, backlash, stiffness):
    """Amplitude (mrad) of the load where the motor swings with amplitude `command` (mrad).

    The gear's teeth first cross their play, `backlash` (mrad) from flank to flank; then shaft and
    gear twist until they carry the `torque` (Nm) that the load resists with, by their `stiffness`
    (Nm/mrad). A command that does not get so far moves nothing.
    """
    return np.maximum(command - 0.5 * backlash - torque / stiffness, 0.0)
