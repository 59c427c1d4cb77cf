# SPDX-License-Identifier: Apache-2.0
"""The fit of a model to recordings, and what it tells of its parameters."""
