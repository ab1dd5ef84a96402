"""A soft stop by way of the mailbox: the console's `finish`, as in a teleoperation, for the job that it names."""

import numpy as np

from rtstack.loop.mailbox import Mailbox
from rtstack.loop.target import TARGET


class Finish:
    """Whether the operator of a job has asked for its soft end. A rtstack.playback.guide.SoftStop."""

    def __init__(self, mailbox: Mailbox, job: int) -> None:
        self._mailbox = mailbox
        self._job = job
        self._sequence = mailbox.target_sequence
        self._target = np.zeros(1, TARGET)
        self._asked = False

    @property
    def asked(self) -> bool:
        """See SoftStop. A block that is being written is looked at again in the next tick."""
        sequence = self._mailbox.target_sequence
        if sequence != self._sequence and self._mailbox.read_target(self._target):
            self._sequence = sequence
            target = self._target[0]
            self._asked = self._asked or bool(target["finish"] and target["job"] == self._job)
        return self._asked
