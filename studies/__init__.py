# SPDX-License-Identifier: Apache-2.0
"""Programs that measure the software and write its documents; none of them is installed. `make help` lists them."""
