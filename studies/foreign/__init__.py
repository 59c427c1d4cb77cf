# SPDX-License-Identifier: Apache-2.0
"""Recordings of devices with equations that neither the rig nor the model has."""
