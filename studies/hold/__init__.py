# SPDX-License-Identifier: Apache-2.0
"""Measure on the virtual rig how well the force along a path is predicted and held."""
