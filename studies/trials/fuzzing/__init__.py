# SPDX-License-Identifier: Apache-2.0
"""Inputs that are changed at random, and what becomes of them: `make fuzz`, docs/reliability.md."""
