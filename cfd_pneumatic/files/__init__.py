# SPDX-License-Identifier: Apache-2.0
"""Read files that users name, and write results whole or not at all."""
