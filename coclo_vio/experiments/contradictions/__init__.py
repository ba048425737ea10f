# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that physics contradicts, made from the bundled sample, and what inspect, run and doctor say of them."""
