"""Simulate, identify and watch a pneumatic constant-force device."""

__version__ = '0.1.0'
