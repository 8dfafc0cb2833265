"""Signals of which the lines and the noise are known, 16 s at 2048 Hz."""

import numpy as np

RATE = 2048.0
T = np.arange(int(16 * RATE)) / RATE
Signal = np.ndarray


def noise(size: float, seed: int = 0) -> Signal:
    return size * np.random.default_rng(seed).normal(size=T.size)


def sine(frequency: float, phase: float = 0.1) -> Signal:
    return np.sin(2.0 * np.pi * frequency * T + phase)


def drive() -> Signal:
    """A full-step line with two driving lines."""
    x = sine(3.33) + 0.4 * sine(53.3, 1.0) + 0.2 * sine(106.6, 2.0)
    return x / np.max(np.abs(x))
