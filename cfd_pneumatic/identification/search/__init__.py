# SPDX-License-Identifier: Apache-2.0
"""Which effects a model lacks: stepwise regression, and which effects could not have shown."""
