# SPDX-License-Identifier: Apache-2.0
"""Combine a device with the uncertainty of its identification: covariances of parameters, and errors of its model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cfd_pneumatic.arguments import check_path
from cfd_pneumatic.arrays import Array
from cfd_pneumatic.device import DESCRIPTORS, REPORT_FILE, Device, Value, identified_device, run_of
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import Covariance, Identification, ModelError, error_beyond_noise
from cfd_pneumatic.model import NAMES
from cfd_pneumatic.path.uncertainty_report import CHANNELS, correlations_of, parameter_name, read_uncertainty
from cfd_pneumatic.reporting import PARAMETER_FILE

_LEAST_EIGENVALUE = 1e-12  # of a correlation matrix; smaller ones are rounding errors


@dataclass(frozen=True)
class IdentifiedDevice:
    """
    A device with the uncertainty of its identification.

    Attributes
    ----------
    device
        The device.
    covariances
        Covariance of the parameters by channel: `cylinder_a`, `cylinder_b`, `force`. Unknown ones are missing.
    model_errors
        Error of the model beyond the sensor's noise by channel [Pa; N for `force`]. Unknown ones are missing.
    source
        File of the parameters, for people.

    """

    device: Device
    covariances: Mapping[str, Covariance] = field(default_factory=dict)
    model_errors: Mapping[str, ModelError] = field(default_factory=dict)
    source: str = 'parameters given in Python'

    @classmethod
    def load(cls, path: Path | str) -> IdentifiedDevice:
        """
        Return the device of an output folder of `identify_bag`, or of a parameter file.

        The uncertainty is read from the `report.json` next to the parameter file if both are of the same run.
        Otherwise the uncertainty is unknown, and also if an older version wrote the report.

        Raises
        ------
        InputError
            If a file cannot be read, the files are of different runs, or the report has an invalid uncertainty.

        """
        check_path('path', path)
        file = Path(path)
        if file.is_dir():
            file = file / PARAMETER_FILE
            if not file.exists():
                raise InputError(f'{path} has no {PARAMETER_FILE}: give the output folder of identify_bag')
        return cls.of_device(Device.load(file))

    @classmethod
    def of_device(cls, device: Device) -> IdentifiedDevice:
        """
        Return a device with the uncertainty in the report next to its parameter file, if there are such files.

        Raises
        ------
        InputError
            If the report has an invalid uncertainty.

        """
        if device.source is None:
            return cls(device)
        covariances, model_errors = read_uncertainty(device.source.with_name(REPORT_FILE), run_of(device.source))
        return cls(device, covariances, model_errors, str(device.source))

    @classmethod
    def of_identification(cls, identification: Identification) -> IdentifiedDevice:
        """Return the identified device."""
        results = {result.name: result for result in identification.channels.values() if result.name in CHANNELS}
        return cls(
            identified_device(identification),
            {name: result.found.covariance for name, result in results.items()},
            {name: error_beyond_noise(result) for name, result in results.items()},
            'identification in Python',
        )

    def deviations(self, share: float = 1.0) -> list[tuple[str, dict[str, Value]]]:
        """
        Return one standard deviation of the parameters along each principal axis of each covariance.

        Parameters
        ----------
        share
            Length of a deviation [standard deviations].

        Returns
        -------
        list of tuple
            Channel, and the changed parameters by their names in `parameters.yaml` [SI].

        Notes
        -----
        A prediction F has the variance sum((F(changed) - F(device))**2) / share**2 to first order. Use a share of 0.01:
        parameters that the recordings hardly determine compensate each other to first order only, and may reach their
        bounds.

        Axes are those of the correlations, because the units of the parameters differ. Gains at several set-points
        change by the same relative amount. An axis points where less is lost at the bounds of the parameters.

        """
        return [
            (channel, self._changed(channel, covariance.names, share * axis))
            for channel, covariance in self.covariances.items()
            for axis in principal_axes(covariance.matrix)
        ]

    def _changed(self, channel: str, names: Sequence[str], changes: Array) -> dict[str, Value]:
        """Return parameters changed along an axis, in the direction in which less is lost at their bounds."""
        directions = [self._limited(channel, names, sign * changes) for sign in (1.0, -1.0)]
        return min(directions, key=lambda direction: direction[1])[0]

    def _limited(self, channel: str, names: Sequence[str], changes: Array) -> tuple[dict[str, Value], float]:
        """Return changed parameters within their bounds, and how much of the changes is lost [share of each change]."""
        values: dict[str, Value] = {}
        lost = 0.0
        for name, change in zip(names, changes.tolist()):
            descriptor = DESCRIPTORS[parameter_name(channel, name)]
            nominal = np.atleast_1d(np.asarray(self.device.value(descriptor.name), dtype=np.float64))
            wanted = nominal * (1.0 + change / np.mean(nominal)) if name in NAMES else nominal + change
            limited = np.clip(wanted, descriptor.lower, descriptor.upper)
            lost += float(np.sum(np.abs(limited - wanted))) / abs(change) if change else 0.0
            values[descriptor.name] = tuple(limited.tolist()) if name in NAMES else float(limited[0])
        return values, lost


def principal_axes(matrix: Array) -> Array:
    """
    Return one standard deviation along each principal axis of a covariance, shape (axes, k).

    Axes are those of the correlations. Each axis has the units of the parameters.
    """
    stds, correlations = correlations_of(matrix)
    variances, directions = np.linalg.eigh(correlations)
    kept = variances > _LEAST_EIGENVALUE
    return np.asarray(np.sqrt(variances[kept])[:, None] * directions[:, kept].T * stds)
