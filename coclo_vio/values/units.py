# SPDX-License-Identifier: BSD-3-Clause
"""Physical constants and factors between units; quantities are in SI units, stamps in integer nanoseconds."""

NS_PER_S = 1_000_000_000
MS_PER_S = 1e3
BYTES_PER_MB = 1e6
GRAVITY_MPS2 = 9.81
MRAD_PER_RAD = 1e3
