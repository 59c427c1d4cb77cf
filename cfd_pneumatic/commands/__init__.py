"""The offline programs."""
