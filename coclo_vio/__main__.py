# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio``: the same as the command ``coclo-vio``."""

from coclo_vio.cli import main

if __name__ == "__main__":
    main()
