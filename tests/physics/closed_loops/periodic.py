"""Derivatives of smooth periodic functions, to rounding, by Fourier series: needs no formulas that could be wrong."""

from __future__ import annotations

import numpy as np


def rate(values: np.ndarray, period: float) -> np.ndarray:
    """Derivative of values at n equally spaced instants of one period, the last one not repeated; shape (n, ...)."""
    n = len(values)
    k = np.fft.fftfreq(n, 1.0 / n)
    k[n // 2 :][: 1 - n % 2] = 0.0  # the highest frequency of an even number of samples has no derivative
    factors = (2j * np.pi / period * k).reshape(-1, *[1] * (np.ndim(values) - 1))
    derivative = np.fft.ifft(factors * np.fft.fft(values, axis=0), axis=0)
    return derivative if np.iscomplexobj(values) else derivative.real
