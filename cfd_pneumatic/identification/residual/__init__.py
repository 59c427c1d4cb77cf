# SPDX-License-Identifier: Apache-2.0
"""What a fit leaves: its noise, its autoregression, and the tests that ask whether it is noise."""
