# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
from hypothesis import strategies as st

from coclo_vio.values.arrays import Array


def _axes() -> st.SearchStrategy[Array]:
    """Unit vectors, among them the coordinate axes."""
    angles = st.tuples(st.floats(-1.0, 1.0), st.floats(-np.pi, np.pi))

    def unit(pair: tuple[float, float]) -> Array:
        z, azimuth = pair
        ring = np.sqrt(1.0 - z * z)
        return np.array([ring * np.cos(azimuth), ring * np.sin(azimuth), z])

    return st.one_of(angles.map(unit), st.sampled_from([*np.eye(3), *-np.eye(3)]))


def _rotvecs(angles: st.SearchStrategy[float]) -> st.SearchStrategy[Array]:
    return st.tuples(_axes(), angles).map(lambda pair: pair[0] * pair[1])


NEAR_ZERO = _rotvecs(st.sampled_from([0.0, 1e-300, 1e-16, 1e-9, 1e-6, 0.99e-4, 1.01e-4, 3e-4, 1e-3, 1e-2]))
GENERIC = _rotvecs(st.floats(0.0, 3.0))
NEAR_PI = _rotvecs(st.sampled_from([1e-9, 1e-7, 1e-5, 1e-3, 1e-2]).map(lambda below: np.pi - below))
BELOW_PI = st.one_of(GENERIC, NEAR_ZERO)
ROTVECS = st.one_of(GENERIC, NEAR_ZERO, NEAR_PI)
TRANSLATIONS = st.tuples(*[st.floats(-20.0, 20.0)] * 3).map(np.array)


def twists(rotvecs: st.SearchStrategy[Array]) -> st.SearchStrategy[Array]:
    return st.tuples(rotvecs, TRANSLATIONS).map(np.concatenate)
