# SPDX-License-Identifier: Apache-2.0
"""Start programs and child processes, compile the kernels and keep their code, and share work among threads."""
