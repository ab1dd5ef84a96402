"""The writer's side of rings, compiled: a record costs a copy and four atomic stores. Imported only by writers.

Seqlock of one writer: record n lives in slot n mod capacity; its sequence word is 2n + 1 while it is being written and
2n + 2 afterwards, and the ring's head is the number of records published. The order of the stores: Boehm, "Can seqlocks
get along with programming language memory models?", MSPC 2012.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hal.compilation import compiled

_WORD = ir.IntType(64).as_pointer()
_BYTES = ir.IntType(8).as_pointer()


@intrinsic
def _load(_typing: Any, _address: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(builder.inttoptr(arguments[0], _WORD), "monotonic", 8)

    return types.int64(types.int64), generate


@intrinsic
def _store_release(_typing: Any, _address: Any, _value: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> None:
        builder.store_atomic(arguments[1], builder.inttoptr(arguments[0], _WORD), "release", 8)

    return types.void(types.int64, types.int64), generate


@intrinsic
def _fence(_typing: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, _arguments: Any) -> None:
        builder.fence("seq_cst")

    return types.void(), generate


@intrinsic
def copy_bytes(_typing: Any, _target: Any, _source: Any, _size: Any) -> Any:
    """Copy `size` bytes from one address to another, in compiled code."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> None:
        target, source, size = arguments
        cgutils.raw_memcpy(builder, builder.inttoptr(target, _BYTES), builder.inttoptr(source, _BYTES), size, 1)

    return types.void(types.int64, types.int64, types.int64), generate


@compiled("void(int64, int64, int64, int64, int64)", nogil=True)
def push(head: int, slots: int, stride: int, mask: int, record: int) -> None:
    """Copy the record at address `record` into the ring whose head and slots are at these addresses.

    stride: bytes a slot (8 of them the sequence word); mask: capacity - 1. Wait-free, never raises, also called by
    compiled code.
    """
    number = _load(head)  # pyright: ignore[reportCallIssue] (numba passes the typing context itself)
    slot = slots + (number & mask) * stride
    _store_release(slot, 2 * number + 1)
    _fence()  # a reader that sees any byte of the new record also sees the odd sequence
    copy_bytes(slot + 8, record, stride - 8)
    _store_release(slot, 2 * number + 2)
    _store_release(head, number + 1)


@compiled("void(int64[:, ::1])", nogil=True)
def push_all(rows: Any) -> None:
    """Push once for each of rows (n, 5), the arguments of `push`: one call for all that a tick publishes."""
    for k in range(len(rows)):
        push(rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4])
