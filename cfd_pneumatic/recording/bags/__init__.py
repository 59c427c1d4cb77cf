# SPDX-License-Identifier: Apache-2.0
"""
Bags: files of serialised messages, to blocks of messages and numbers, and back.

Nothing here knows what a signal is.
"""
