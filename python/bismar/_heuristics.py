"""Heuristics of one's own: what they are given, and how they are called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, NamedTuple, Tuple

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt


class Moments(NamedTuple):
    """What the samples at first surfaces have shown so far, for a heuristic of one's own; arrays (H, W), row 0 at the top.

    With the densities p_l of light samples and p_b of BSDF samples, light share a, and the integrand f: r = (p_l - p_b) /
    (p_l + p_b), Z = f / (a p_l + (1 - a) p_b), Y = 2 f / (p_l + p_b), W = Y Z, W and Z summed over colour channels
    (docs/balance.md).
    """

    paths: npt.NDArray[np.uint32]
    """Number of paths."""
    light_share: npt.NDArray[np.float32]
    """Light share of the last pass."""
    w: npt.NDArray[np.float64]
    """Sum of W."""
    wr: npt.NDArray[np.float64]
    """Sum of W r."""
    wr2: npt.NDArray[np.float64]
    """Sum of W r^2."""
    zr: npt.NDArray[np.float64]
    """Sum of Z r."""
    zr2: npt.NDArray[np.float64]
    """Sum of Z r^2."""


def of_arrays(balance: Callable[[Moments], Any], shape: Tuple[int, int]) -> Callable[[Any, Any, Any], Any]:
    """`balance` for the native half: of flat arrays."""
    def shares(paths: Any, light_share: Any, moments: Any) -> Any:
        height, width = shape if shape[0] * shape[1] == len(paths) else (1, len(paths))
        sums = np.moveaxis(moments.reshape(height, width, 5), 2, 0)
        found = balance(Moments(paths.reshape(height, width), light_share.reshape(height, width), *sums))
        return np.broadcast_to(np.asarray(found, np.float32), (height, width)).flatten()

    return shares
