"""The check of an answer by Monte Carlo on the simulator itself."""

from aleator.verification.check import FEW_SAMPLES, verify
from aleator.verification.choice import MonteCarlo, Score, Verification
from aleator.verification.emulator import Emulator, SurfaceEmulator
from aleator.verification.movement import Movement, movement

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
