# SPDX-License-Identifier: Apache-2.0
"""Read the displacement alone: `read_recording` needs a pressure as well."""

from __future__ import annotations

from cfd_pneumatic.messages import NANOSECONDS
from cfd_pneumatic.recording.bags import Bag
from cfd_pneumatic.recording.cleaning import clean
from cfd_pneumatic.recording.outliers import screened
from cfd_pneumatic.recording.sampling import Defaults, read_samples
from cfd_pneumatic.recording.signals import Signal
from cfd_pneumatic.recording.sources import SignalSource


def read_displacement(bag: Bag, topic: str, joint: str) -> tuple[Signal, list[str]]:
    """
    Return the displacement in a topic of joint states, cleaned as in a recording, and notes on defects.

    Parameters
    ----------
    bag : Bag
        An open bag.
    topic : str
        Full name of the topic, which holds JointState.
    joint : str
        Name of the piston in the joint states.

    Returns
    -------
    Signal
        Displacement [m] over the time since its first sample [s].
    list of str
        Defects of the samples and their treatment.

    Raises
    ------
    InputError
        If no message has the joint, or the samples are not usable.

    """
    source = SignalSource('displacement', None, topic)
    (samples,), notes = read_samples(bag, [source], None, Defaults(joint, force_axis='x'), None)
    cleaned = screened(clean(samples.times, samples.raw, source.name), source.role, source.name)
    seconds = (cleaned.times - cleaned.times[0]) / NANOSECONDS
    return Signal(seconds, cleaned.values), [*notes, *cleaned.notes]
