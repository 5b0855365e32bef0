"""The network's shape and the formula for the numbers in golden files, shared by the scripts that write them with PyTorch and
by tests without PyTorch. The Rust tests make the same numbers (trainer/tests/network/formula.rs)."""

import numpy as np

# VGN's ConvNet: name, channels in and out, side of the kernel, stride
LAYERS = [
    ("encoder.conv1", 1, 16, 5, 2),
    ("encoder.conv2", 16, 32, 3, 2),
    ("encoder.conv3", 32, 64, 3, 2),
    ("decoder.conv1", 64, 64, 3, 1),
    ("decoder.conv2", 64, 32, 3, 1),
    ("decoder.conv3", 32, 16, 5, 1),
    ("conv_qual", 16, 1, 5, 1),
    ("conv_rot", 16, 4, 5, 1),
    ("conv_width", 16, 1, 5, 1),
]


def noise(count: int, seed: int) -> np.ndarray:
    """`count` numbers in [0, 1), multiples of 2^-24: Wellons' lowbias32 hash of position + seed * 0x9E3779B9."""
    with np.errstate(over="ignore"):
        x = np.arange(count, dtype=np.uint32) + np.uint32(seed * 0x9E3779B9 & 0xFFFFFFFF)
        x ^= x >> np.uint32(16)
        x *= np.uint32(0x7FEB352D)
        x ^= x >> np.uint32(15)
        x *= np.uint32(0x846CA68B)
        x ^= x >> np.uint32(16)
    return (x >> np.uint32(8)).astype(np.float64) / 2**24
