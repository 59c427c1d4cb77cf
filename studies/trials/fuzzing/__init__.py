# SPDX-License-Identifier: Apache-2.0
"""Give randomly changed inputs to their readers: `make fuzz`, docs/explanation/reliability.md."""
