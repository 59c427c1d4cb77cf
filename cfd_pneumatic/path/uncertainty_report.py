# SPDX-License-Identifier: Apache-2.0
"""Read the uncertainty of an identification from `report.json`: covariances of parameters, and errors of the model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.device import DESCRIPTORS, report_in
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Covariance, ModelError
from cfd_pneumatic.model import NAMES

CHANNELS: Mapping[str, str] = {**dict.fromkeys(CYLINDERS, 'pa'), 'force': 'n'}
"""Channels of a device, and the suffixes of their keys in a report."""

_LARGEST_ROUNDING = 1e-6  # of a correlation; the report has all digits


def read_uncertainty(report: Path, run: str | None) -> tuple[dict[str, Covariance], dict[str, ModelError]]:
    """
    Return the covariances and the model errors of a report by channel.

    Both are empty if there is no report, if the report is of another run, or if an older version wrote the report.

    Parameters
    ----------
    report, run
        Path of report.json, and the run of `identify_bag` that wrote the parameter file; None if unknown.

    Raises
    ------
    InputError
        If the report cannot be read, or an uncertainty in the report is invalid.

    """
    if run is None or not report.exists():
        return {}, {}
    try:
        content = report_in(report)
        blocks = _blocks(content) if isinstance(content, dict) and content.get('run') == run else {}
        covariances = {
            channel: _covariance(channel, block['covariance'])
            for channel, block in blocks.items()
            if 'covariance' in block
        }
        errors = {
            channel: _model_error(channel, block[key])
            for channel, block in blocks.items()
            if (key := f'model_error_{CHANNELS[channel]}') in block
        }
    except InputError as error:
        raise InputError(f'{report} {error}: identify again') from error
    return covariances, errors


def parameter_name(channel: str, name: str) -> str:
    """Return the name in `parameters.yaml` of a channel's parameter: `cylinder_a.k_x`, `area`."""
    if channel in CYLINDERS:
        return f'{channel}.{name}'
    return f'{CONTACT_FORCE}.{name}' if '.' in name else name


def _blocks(content: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the block of each channel in a report."""
    cylinders = content.get('cylinders')
    channels = {**content, **cylinders} if isinstance(cylinders, dict) else content
    blocks = {channel: channels[channel] for channel in CHANNELS if channel in channels}
    for channel, block in blocks.items():
        if not isinstance(block, dict):
            raise InputError(f'has no results for {channel}')
    return blocks


def _covariance(channel: str, entry: object) -> Covariance:
    """Return a covariance of JSON types; refuse matrices that are no covariance."""
    names = entry.get('parameters') if isinstance(entry, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f'has a covariance of {channel} without a list of parameters')
    if len({*names}) < len(names) or not all(_is_searched(channel, name) for name in names):
        raise InputError(f'has a covariance of {channel} with parameters that no device has, or twice')
    matrix = _matrix(entry.get('matrix'), len(names)) if isinstance(entry, dict) else None
    if matrix is None:
        raise InputError(f'has a covariance of {channel} that is no matrix of {len(names)} by {len(names)} numbers')
    if np.any(np.diag(matrix) < 0.0):
        raise InputError(f'has a covariance of {channel} with a negative variance')
    with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
        _, correlations = correlations_of(matrix)
        differences = np.abs(correlations - correlations.T)
    if not np.all(differences <= _LARGEST_ROUNDING):  # an overflow is not finite
        raise InputError(f'has a covariance of {channel} that is not symmetric')
    if np.min(np.linalg.eigvalsh(correlations), initial=0.0) < -_LARGEST_ROUNDING:
        raise InputError(f'has a covariance of {channel} that is not positive')
    return Covariance(tuple(names), matrix)


def _is_searched(channel: str, name: str) -> bool:
    """Return whether a fit may have searched a parameter."""
    descriptor = DESCRIPTORS.get(parameter_name(channel, name))
    return descriptor is not None and (type(descriptor.default) is float or name in NAMES)


def _matrix(rows: object, size: int) -> Array | None:
    """Return a square matrix of JSON types, or None if the rows are no such matrix of finite numbers."""
    if not isinstance(rows, list) or len(rows) != size:
        return None
    if not all(isinstance(row, list) and len(row) == size and all(map(_is_number, row)) for row in rows):
        return None
    return np.array(rows, dtype=np.float64).reshape(size, size)


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the range of floats
        return False


def correlations_of(matrix: Array) -> tuple[Array, Array]:
    """Return the standard deviations, shape (k,), and the correlations, shape (k, k), of a covariance."""
    stds = np.sqrt(np.diag(matrix))
    scales: NDArray[np.float64] = np.where(stds > 0.0, stds, 1.0)
    return stds, matrix / np.outer(scales, scales)


def _model_error(channel: str, entry: object) -> ModelError:
    """Return a model error of JSON types; null is unknown."""
    defaults = {'rest': math.nan, 'motion': math.nan, 'per_step': None}
    values = [entry.get(name, missing) for name, missing in defaults.items()] if isinstance(entry, dict) else [math.nan]
    if not all(value is None or (_is_number(value) and value >= 0.0) for value in values):
        raise InputError(f'has a model error of {channel} that is not positive or null, at rest and in motion')
    return ModelError(*(None if value is None else float(value) for value in values))
