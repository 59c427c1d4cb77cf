# SPDX-License-Identifier: Apache-2.0
"""Recordings with their smoothed displacement, split into parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from cfd_pneumatic.identification.channels import Channel
from cfd_pneumatic.identification.data import FRACTIONS, Experiment, Motion, Split, observed_motion, split_recordings
from cfd_pneumatic.recording import Recording


@dataclass(frozen=True)
class Prepared:
    """
    Recordings with their smoothed displacement.

    Attributes
    ----------
    recordings, motions
        Recordings, and the smoothed motion of the piston in each.
    splits, no_test
        Parts of each recording, and the reason for a missing test part, or None.

    """

    recordings: tuple[Recording, ...]
    motions: tuple[Motion, ...]
    splits: tuple[Split, ...]
    no_test: str | None

    def holding(self, channel: Channel) -> tuple[int, ...]:
        """Return the indices of the recordings that contain a channel."""
        recordings = enumerate(self.recordings)
        return tuple(index for index, recording in recordings if channel.signal(recording) is not None)

    def experiments(self, channel: Channel) -> tuple[Experiment, ...]:
        """Return a channel's experiments, one for each recording that contains the channel."""
        return tuple(
            replace(channel.experiment(self.recordings[index], self.motions[index], self.splits[index]), index=rank)
            for rank, index in enumerate(self.holding(channel))
        )


def prepare_recordings(recordings: Sequence[Recording], fractions: tuple[float, float, float] = FRACTIONS) -> Prepared:
    """
    Smooth the displacement of recordings, and split each recording into parts.

    Raises
    ------
    InputError
        If a recording has no motion or too few samples.

    """
    motions, strokes = zip(*(observed_motion(recording) for recording in recordings))
    splits, no_test = split_recordings(list(strokes), fractions)
    return Prepared(tuple(recordings), tuple(motions), tuple(splits), no_test)
