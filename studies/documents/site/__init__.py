# SPDX-License-Identifier: Apache-2.0
"""The documentation site: `make site` writes build/site."""
