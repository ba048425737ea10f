# SPDX-License-Identifier: BSD-3-Clause
"""Experiments on the product, none of which it needs: Table I, benchmarks, rivals, studies, the sample's maker."""
