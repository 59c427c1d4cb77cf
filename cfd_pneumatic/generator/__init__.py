# SPDX-License-Identifier: Apache-2.0
"""The generator that writes `cfd_pneumatic/model/composed.py`: `python -m cfd_pneumatic.generator`."""
