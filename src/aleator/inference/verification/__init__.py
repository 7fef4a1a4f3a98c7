"""The check of an answer by Monte Carlo on the simulator itself."""

from aleator.inference.verification.check import FEW_SAMPLES, verify
from aleator.inference.verification.choice import MonteCarlo, Score, Verification
from aleator.inference.verification.emulator import Emulator, SurfaceEmulator
from aleator.inference.verification.score_step import Movement, movement

__all__ = [
    "FEW_SAMPLES",
    "Emulator",
    "MonteCarlo",
    "Movement",
    "Score",
    "SurfaceEmulator",
    "Verification",
    "movement",
    "verify",
]
