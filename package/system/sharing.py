"""Rows that several threads take in turns, as compiled code does it: no thread waits for Python to be handed a row.

What the threads of a job read and write is its `shares`, int64, (LINE * (2 + threads),), empty where one is alone. A
thread takes its own rows from their first on, the same ones in every job, which its cache still holds. Whose own are
done takes those of others, from their last on: few, and again the same ones.
"""

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic as numbas_intrinsic
from numpy.typing import NDArray

from wayfield.system.compiled import compiled, inlined

LINE = 8  # numbers of a line of the cache: what one thread writes does not take from another what stands beside it
BEGUN = 0  # not 0: there are rows to take
BRIEF = 1  # not 0: the first thread has other work, and returns once a quarter of its own rows is taken
INSIDE = LINE  # threads, besides the first, that may be at work
_FIRST = 2 * LINE  # parts taken of each thread's own: from the front, and 2^32 times those from the back

PART = 32  # rows taken at once
_LOOKS = 1 << 19  # at a number that another thread shall change, before the system is asked to wait: some 0.1 ms


def shares_of(threads: int) -> NDArray[np.int64]:
    """Returns the shares of a job of which nothing has been taken."""
    return np.zeros(_FIRST + LINE * threads, np.int64)


intrinsic: Any = numbas_intrinsic  # its types are those of the code that it is made of, not of calls of what it makes


@intrinsic
def add(typingctx, shares, place, number):
    """Adds to a number of the shares and returns what it was; nothing comes between."""

    def code(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.atomic_rmw("add", builder.gep(array.data, [arguments[1]]), arguments[2], "seq_cst")

    return types.int64(shares, types.int64, types.int64), code


@intrinsic
def look(typingctx, shares, place):
    """Returns a number of the shares as it is now, and with it all that was written before it."""

    def code(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.load_atomic(builder.gep(array.data, [arguments[1]]), "seq_cst", 8)

    return types.int64(shares, types.int64), code


@inlined
def next_rows(shares, thread, last, count):
    """Returns the first row, and the one behind the last, that a thread does next; as one where none are left.

    Args:
        last: where the rows ended that it has done; 0 in the beginning.
        count: of all rows.
    """
    if shares.shape[0] == 0:
        return last, count
    threads = shares.shape[0] // LINE - 2
    parts = (count + PART - 1) // PART
    for k in range(threads):
        whose = (thread + k) % threads
        start = parts * whose // threads
        own = parts * (whose + 1) // threads - start
        place = _FIRST + LINE * whose
        if thread == 0 and shares[BRIEF] != 0 and 4 * look(shares, place) >= own:
            break
        taken = add(shares, place, 1 if k == 0 else 1 << 32)
        front = taken & 0xFFFFFFFF
        back = taken >> 32
        if front + back < own:
            part = start + (front if k == 0 else own - 1 - back)
            return part * PART, min((part + 1) * PART, count)
    return count, count


@compiled
def entered(shares):
    """Notes that a thread besides the first is about to take rows."""
    add(shares, INSIDE, 1)


@compiled
def left(shares, coming):
    """Notes that a thread takes no more, and waits a moment; returns whether the job to come has begun.

    To be compiled code while it waits lets Python go: the first thread, which is there next, need not ask for it.
    """
    add(shares, INSIDE, -1)
    for _ in range(_LOOKS):
        begun = look(coming, BEGUN) != 0
        if begun:
            break
    return begun


@compiled
def all_left(shares):
    """Waits a moment; returns whether no thread but the first is at work."""
    for _ in range(_LOOKS):
        alone = look(shares, INSIDE) == 0
        if alone:
            break
    return alone
