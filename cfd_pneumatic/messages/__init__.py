# SPDX-License-Identifier: Apache-2.0
"""
Serialised messages: their definitions, where a number is in them, and making them of numbers.

Bags and nodes share this; nothing here knows a file of a bag, a node, or a signal.
"""
