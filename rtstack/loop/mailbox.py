"""The mailbox: aligned 64-bit words in shared memory, from the console's processes to the real-time loop.

The loop only loads words, so that no writer can make it wait. A word has one meaning and is written whole; the blocks
of a teleoperation's target and of a policy's chunk stand behind a sequence word of their own each, odd while it is
being written. A sign of life is one word: the host's time.monotonic_ns, 0 for never.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hal.base.shared import Block, remove_block
from rtstack.log.errors import LogError


class Release(IntEnum):
    """Why the clutch is not held."""

    NOT_YET = 0  # it was not held since the session began
    RELEASED = 1  # by the operator
    LOST = 2  # the page was hidden, closed, or lost the keyboard focus
    DROPPED = 3  # by the console: its hand moved as no hand can, or was lost by its tracker


# clutch_ns: host's time.monotonic_ns() of the last sign of life of a clutch that is held, 0 while it is not; release:
# Release; finish: not 0 to end the session; policy: number of the lease of the policy that leads while the clutch is
# not held, 0 for none; speed m/s; stiffness N/m; pose T_world_ee of (left, right): m, wxyz; NaN for
# an arm that is not there.
# Of the last command that was applied: its sequence, when it was made and came, the picture that it answers, when that
# was of the robot and when it was seen (ns of the same clock, 0 before the first one). dropped: how many were not
# applied: too old, out of order, made on an old picture, for another reason
TARGET = np.dtype([
    ("job", "i8"), ("clutch_ns", "i8"), ("release", "i8"), ("finish", "i8"), ("policy", "i8"), ("speed", "f8"),
    ("stiffness", "f8"), ("pose", "f8", (2, 7)), ("sequence", "i8"), ("made_ns", "i8"), ("came_ns", "i8"),
    ("picture", "i8"), ("picture_ns", "i8"), ("seen_ns", "i8"), ("dropped", "i8", 4),
])  # fmt: skip

CHUNK_POSES = 16  # in one answer

# One answer of a policy. lease: the one that it was made under; beat_ns: host's time.monotonic_ns() when it came, a
# sign of life; observed_ns: robot's time of the first arm's state that it answers; pose k of `count` is due (k + 1)
# step_ns later. xi: of the posture joint, rad, not a number where the posture is left as it is
CHUNK = np.dtype([
    ("job", "i8"), ("lease", "i8"), ("beat_ns", "i8"), ("observed_ns", "i8"), ("step_ns", "i8"), ("count", "i8"),
    ("pose", "f8", (CHUNK_POSES, 2, 7)), ("xi", "f8", (CHUNK_POSES, 2)),
])  # fmt: skip

_MAGIC = 0x7274_6D62_6F78_0003  # "rtmbox", layout version 3
TARGET_WORDS, CHUNK_WORDS = TARGET.itemsize // 8, CHUNK.itemsize // 8
TAKEN_S = 0.5  # ours: a busy machine makes a tick long now and then
NOT_TAKEN = f"STOP was not taken by the control loop within {TAKEN_S:g} s: use the emergency stop"


class _Word(IntEnum):
    """Index of a word. New words go to the end; a changed meaning is a new layout version."""

    MAGIC = 0
    STOP = 1
    CONSOLE_BEAT = 2
    OPERATOR_BEAT = 3
    TARGET_SEQUENCE = 4
    TARGET = 5  # and the words after it
    CHUNK_SEQUENCE = TARGET + TARGET_WORDS
    CHUNK = CHUNK_SEQUENCE + 1  # and the words after it
    TURN = CHUNK + CHUNK_WORDS


_SIZE_BYTES = 4096  # a page


class MailboxError(LogError):
    """The mailbox cannot be created or attached; the message says why."""


class Mailbox:
    """One mailbox. The process that created it owns it, and removes it when it closes it."""

    __slots__ = ("_block", "_words")

    def __init__(self, block: Block) -> None:
        self._block = block
        self._words = memoryview(block.memory).cast("q")

    @classmethod
    def create(cls, name: str) -> "Mailbox":
        """Create the mailbox `name`, all words zero. Raises MailboxError when it exists or the name is no name."""
        _check(name)
        try:
            box = cls(Block.create(name, _SIZE_BYTES))
        except OSError as error:
            raise MailboxError(f"mailbox {name}: cannot be created: {error.strerror}") from None
        box._words[_Word.MAGIC] = _MAGIC
        return box

    @classmethod
    def attach(cls, name: str) -> "Mailbox":
        """Attach to the mailbox `name` of another process. Raises MailboxError when it is not there, or not ours."""
        _check(name)
        try:
            box = cls(Block.attach(name))
        except (OSError, ValueError) as error:  # ValueError: mmap's, of an empty file
            raise MailboxError(f"mailbox {name}: cannot be attached: {getattr(error, 'strerror', error)}") from None
        if len(box._words) * 8 != _SIZE_BYTES or box._words[_Word.MAGIC] != _MAGIC:
            box.close()
            raise MailboxError(f"mailbox {name}: another layout version")
        return box

    def request_stop(self) -> int:
        """Ask the loop for a controlled stop, any time. Returns its turn, for `stop_taken`: 0 where no session
        controlled the arms."""
        self._words[_Word.STOP] = 1
        return self._words[_Word.TURN]

    def stop_taken(self, turn: int) -> bool:
        """Return whether a whole tick has passed since a STOP that came at this turn, or that session is over."""
        return not 0 < turn <= self._words[_Word.TURN] < turn + 2

    def turn(self, number: int) -> None:
        """Note that so many ticks are over, their torques out. For the loop: 1 before the first one, 0 at its end."""
        self._words[_Word.TURN] = number

    @property
    def stop_requested(self) -> bool:
        """Whether a stop is asked for: one load of one word."""
        return self._words[_Word.STOP] != 0

    def clear_stop(self) -> None:
        """Forget the request. Only for the process that owns the robot, at the moment when an operator arms."""
        self._words[_Word.STOP] = 0

    def console_beat(self, now_ns: int) -> None:
        """Give the console's sign of life. now_ns: time.monotonic_ns() of this host."""
        self._words[_Word.CONSOLE_BEAT] = now_ns

    def operator_beat(self, now_ns: int) -> None:
        """Pass on a sign of life of the operator who has control. now_ns: time.monotonic_ns() of this host."""
        self._words[_Word.OPERATOR_BEAT] = now_ns

    @property
    def console_beat_ns(self) -> int:
        """When the console gave its last sign of life, 0 for never."""
        return self._words[_Word.CONSOLE_BEAT]

    @property
    def operator_beat_ns(self) -> int:
        """When the operator gave the last sign of life, 0 for never."""
        return self._words[_Word.OPERATOR_BEAT]

    def write_target(self, target: NDArray) -> None:
        """Write a target (1,) of TARGET. For one writer at a time."""
        self._write(_Word.TARGET_SEQUENCE, target)

    def write_chunk(self, chunk: NDArray) -> None:
        """Write a policy's answer, (1,) of CHUNK. For one writer at a time."""
        self._write(_Word.CHUNK_SEQUENCE, chunk)

    @property
    def target_sequence(self) -> int:
        """Even number that changes with every target; 0 before the first one, odd while one is being written."""
        return self._words[_Word.TARGET_SEQUENCE]

    @property
    def chunk_sequence(self) -> int:
        """The same of a policy's answers."""
        return self._words[_Word.CHUNK_SEQUENCE]

    def read_target(self, target: NDArray) -> bool:
        """Copy the newest target into (1,) of TARGET. Returns False, and leaves anything in it, while it is written."""
        return self._read(_Word.TARGET_SEQUENCE, target)

    def read_chunk(self, chunk: NDArray) -> bool:
        """Copy the newest answer of a policy into (1,) of CHUNK, as `read_target` does."""
        return self._read(_Word.CHUNK_SEQUENCE, chunk)

    def _write(self, at: int, record: NDArray) -> None:
        words = self._words
        sequence = words[at] | 1  # odd: what a writer that died left half written stays unread
        words[at] = sequence
        words[at + 1 : at + 1 + record.itemsize // 8] = record.view(np.longlong).data
        words[at] = sequence + 1

    def _read(self, at: int, record: NDArray) -> bool:
        words = self._words
        sequence = words[at]
        record.view(np.longlong).data[:] = words[at + 1 : at + 1 + record.itemsize // 8]
        return sequence % 2 == 0 and words[at] == sequence

    def close(self) -> None:
        """Let go of the memory; the owner also removes the name. May be called twice."""
        self._words.release()
        self._block.close()


def remove_mailbox(name: str) -> None:
    """Remove what an owner that was killed left behind. Does nothing when there is nothing."""
    _check(name)
    remove_block(name)


def _check(name: str) -> None:
    if not name or not all(letter.isascii() and (letter.isalnum() or letter in "-_") for letter in name):
        raise MailboxError(f"mailbox {name!r}: a name has letters, digits, - and _ only")
