"""Scans of occupancy grids: many beams at once, with the bits of `grids.grid_ray`, which is their specification.

A leap, of a beam that goes up the columns and rises by its slope; n is the room of its cell, 3 here:

       +---+---+---+
       |   |   |   |->  it leaves the square of n x n free cells by the far side, or by the top where it rises so far;
       +---+---+-.-'    `along` and `aside` count cells from where it began, along the axis to which it is nearer
       |   |.-'|   |    and across it
       +-.-+---+---+
       o'  |   |   |
       +---+---+---+

The next room is looked up in the cell that it enters: space leaping, as ray tracing knows it (Cohen and Sheffer,
Proximity Clouds, The Visual Computer 1994), with a square for each octant in place of one distance all around.
"""

import collections
import math

import numpy as np
from numba import types

from wayfield.envs.world.grids import look_along, same_bits, seen_from
from wayfield.system.compiled import compiled, inlined

# So many beams go on side by side, by the same arithmetic without a branch: that a processor does for several at once.
# No power of two, so that their numbers do not all want the same place in its cache.
TOGETHER = 1008
BESIDE = 8  # of those, so many at once; a divisor
# the numbers of a beam on its way, in rows of TOGETHER; those from `last` on are the bits of whole ones
_BEAM = collections.namedtuple("_BEAM", "slope start sure last room along aside step_along step_aside here")
_AT = _BEAM(*(np.uint64(TOGETHER * row) for row in range(len(_BEAM._fields))))
SCRATCH = TOGETHER * len(_BEAM._fields)  # numbers that `scan_grid` needs room for

# for BESIDE beams each: which of them have not all ended; whose they are; and where his grid begins
_GOING = TOGETHER // BESIDE
_HELD = _GOING
_FIRST = 2 * _GOING
WORDS = 3 * _GOING

# instead of a beam's `along`: it left a grid beyond which all is free; single precision cannot tell where it goes on
_OUT = np.int32(-1)
_UNSURE = np.int32(-2)
_ROUNDING = np.float32(2.0**-24)  # relative, of single precision
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)


# Of single precision all is kept in one array: of two a compiler would not know that they never overlap, and would do
# nothing for several beams at once.
bits = same_bits(types.float32, types.int32)
whole = same_bits(types.int32, types.float32)


@compiled
def scan_grid(frame, cells, pose, beams, ranges, i, column, scratch, words):
    """Shortens ranges[i, column:] (m) to the distance along each beam to what is occupied in a scenario's grid.

    `ray_from` for many beams at once, with the same bits: in turns those that have not ended leap, BESIDE at once. In
    which cell a beam ends is found in single precision, and how far that is, from the side that it enters by, in double
    precision. What passes the corner of a cell too near by for single precision to tell the side is left to `ray_from`.

    Args:
        pose: x, y (m), heading (rad).
        beams: (2, n) cosines and sines of the beams in the body frame.
        ranges: (b, n) array of any float type, as `sensing.scan_ranges` leaves it.
        scratch: (SCRATCH,) room for numbers of single precision.
        words: (WORDS,) room for whole ones.
    """
    seen = seen_from(frame, pose)
    for first in range(0, beams.shape[1], TOGETHER):
        part = first, min(beams.shape[1] - first, TOGETHER), 0
        if set_out(frame, cells, seen, beams, part, ranges, i, column, scratch, words):
            travel(cells, scratch, words, part[1])
            arrive(frame, cells, seen, beams, part, ranges, i, column, scratch)


@inlined
def way_of(beams, k, cosine, sine):
    """Returns the unit vector of beam k in a grid where the heading has that cosine and that sine."""
    # unsigned: a signed index is first asked whether it counts from the end
    ahead = beams[0, np.uint64(k)]
    aside = beams[1, np.uint64(k)]
    return cosine * ahead - sine * aside, sine * ahead + cosine * aside


@inlined
def set_out(frame, cells, seen, beams, part, ranges, i, column, scratch, words):
    """Writes where beams of a scan begin, for `travel`; returns False where there is nothing to travel for.

    From beyond the grid the beams are looked along at once, and there is nothing left.

    Args:
        seen: `seen_from`.
        part: the first beam meant, how many, and where those stand among what goes on together.
    """
    if frame.grid_cell == 0.0:
        return False
    first, count, at = part
    u, v, cosine, sine = seen
    if not (abs(cosine) < 2.0 and abs(sine) < 2.0):
        return False  # no number, or one that is no angle: such beams meet nothing
    if not (0.0 <= u < frame.grid_columns and 0.0 <= v < frame.grid_rows):
        for k in range(first, first + count):
            look_along(frame, cells, (u, v), way_of(beams, k, cosine, sine), ranges, i, np.uint64(column + k))
        return False
    aim(frame, cells, seen, beams, part, ranges, i, column, scratch)
    # beams that are none, up to a whole number of BESIDE, are where there is no room
    end = at + (count + BESIDE - 1) // BESIDE * BESIDE
    for k in range(np.uint64(at + count), np.uint64(end)):
        scratch[_AT.room + k] = bits(np.int32(0))
    for k in range(np.uint64(at // BESIDE), np.uint64(end // BESIDE)):
        words[np.uint64(_FIRST) + k] = frame.grid_first
    return True


@inlined
def aim(frame, cells, seen, beams, part, ranges, i, column, scratch):
    """Writes what `leap` reads of beams that begin within the grid.

    All as if each went up the rows and the columns, and counted from the cell where it begins, along the axis to which
    it is nearer: how far aside of that it is at `along` is start + along slope, with a slope of at most 1.

    Args:
        seen: `seen_from`.
        part: as in `set_out`.
    """
    first, count, at = part
    u, v, cosine, sine = seen
    j = math.floor(u)
    row = math.floor(v)
    width = np.int32(frame.grid_columns + 2)
    size = np.int32((frame.grid_rows + 2) * (frame.grid_columns + 2))
    begin = np.int32((np.int64(row) + 1) * (frame.grid_columns + 2) + np.int64(j) + 1)
    begin_back = np.int32(begin + size)
    begin_down = np.int32(begin + 2 * size)
    begin_back_down = np.int32(begin + 3 * size)
    steep = np.int32(4 * size)
    # all begin in one cell: of its rooms there are eight
    ahead_up = np.int32(cells[np.uint64(frame.grid_first + begin)])
    back_up = np.int32(cells[np.uint64(frame.grid_first + begin_back)])
    ahead_down = np.int32(cells[np.uint64(frame.grid_first + begin_down)])
    back_down = np.int32(cells[np.uint64(frame.grid_first + begin_back_down)])
    up_ahead = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin + steep))])
    up_back = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin_back + steep))])
    down_ahead = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin_down + steep))])
    down_back = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin_back_down + steep))])
    across = np.float32(frame.grid_rows + frame.grid_columns)
    cells_per_metre = np.float32(1.0 / frame.grid_cell)
    part_u = np.float32(u - j)
    part_v = np.float32(v - row)
    # on its own, as double precision goes on half as many beams at once
    for k in range(count):
        du, dv = way_of(beams, first + k, cosine, sine)
        scratch[_AT.slope + np.uint64(at + k)] = du
        scratch[_AT.start + np.uint64(at + k)] = dv
    for k in range(count):
        place = np.uint64(at + k)
        du = scratch[_AT.slope + place]
        dv = scratch[_AT.start + place]
        left = du < _ZERO
        down = dv < _ZERO
        swap = abs(dv) > abs(du)
        reach = np.float32(ranges[i, np.uint64(column + first + k)]) * cells_per_metre
        reach = reach if reach < across else across
        along = abs(dv if swap else du)
        slope = abs(du if swap else dv) / along
        from_u = _ONE - part_u if left else part_u
        from_v = _ONE - part_v if down else part_v
        begun = from_v if swap else from_u
        scratch[_AT.slope + place] = slope
        scratch[_AT.start + place] = (from_u if swap else from_v) - begun * slope
        # by no less than three times what rounding may put a crossing off: five roundings of where it is, and eight of
        # a cell. What passes so near by a corner of what is free on its way ends the leap so near by one, too
        scratch[_AT.sure + place] = _HALF - _ROUNDING * (np.float32(15.0) * reach + np.float32(75.0))
        # where it goes no further, and rounding does not matter
        scratch[_AT.last + place] = bits(np.int32(begun + reach * along + np.float32(2.0)))
        room_up = back_up if left else ahead_up
        room_down = back_down if left else ahead_down
        room_flat = room_down if down else room_up
        steep_up = up_back if left else up_ahead
        steep_down = down_back if left else down_ahead
        room_steep = steep_down if down else steep_up
        scratch[_AT.room + place] = bits(room_steep if swap else room_flat)
        here_up = begin_back if left else begin
        here_down = begin_back_down if left else begin_down
        here = here_down if down else here_up
        scratch[_AT.here + place] = bits(np.int32(here + (steep if swap else np.int32(0))))
        step_u = np.int32(-1) if left else np.int32(1)
        step_v = np.int32(-width) if down else width
        scratch[_AT.step_along + place] = bits(step_v if swap else step_u)
        scratch[_AT.step_aside + place] = bits(step_u if swap else step_v)
        scratch[_AT.along + place] = bits(np.int32(0))
        scratch[_AT.aside + place] = bits(np.int32(0))


@inlined
def arrive(frame, cells, seen, beams, part, ranges, i, column, scratch):
    """Shortens the ranges of the beams of `set_out` that have met something.

    The cell in which a beam has ended is entered by that of its two sides which is met last: as far away as `ray_from`
    says, to the bit.

    Args:
        seen: `seen_from`.
        part: as in `set_out`.
    """
    first, count, at = part
    u, v, cosine, sine = seen
    if frame.grid_closed == 0:
        stop_inside(frame, u, v, scratch, at, count)
    j = np.int32(math.floor(u))
    row = np.int32(math.floor(v))
    back_j = np.int32(-j)
    back_row = np.int32(-row)
    least = np.int32(0)
    for k in range(count):
        du, dv = way_of(beams, first + k, cosine, sine)
        along = whole(scratch[_AT.along + np.uint64(at + k)])
        aside = whole(scratch[_AT.aside + np.uint64(at + k)])
        swap = abs(whole(scratch[_AT.step_along + np.uint64(at + k)])) > 1
        # whether it came from beside the cell: at the side before it, it was not yet at its height. Where it begins, it
        # came from nowhere else
        height = np.float32(along) * scratch[_AT.slope + np.uint64(at + k)] + scratch[_AT.start + np.uint64(at + k)]
        beside = (along == 0) | (aside > np.int32(height))
        by_u = beside == swap
        far = aside if beside else along
        far_u = back_j if du < 0.0 else j
        far_v = back_row if dv < 0.0 else row
        from_u = u - 1.0 if du < 0.0 else -u
        from_v = v - 1.0 if dv < 0.0 else -v
        side = np.float64(np.int32(far + (far_u if by_u else far_v))) + (from_u if by_u else from_v)
        gone = side * (1.0 / abs(du if by_u else dv))
        # where it begins, too, and where that makes it no number
        distance = (gone if gone > 0.0 else 0.0) * frame.grid_cell
        place = np.uint64(column + first + k)
        so_far = ranges[i, place]
        ranges[i, place] = distance if (distance < so_far) & (along >= 0) else so_far
        least = along if along < least else least
    if least == _UNSURE:
        look_closely(frame, cells, seen, beams, part, ranges, i, column, scratch)


@compiled
def look_closely(frame, cells, seen, beams, part, ranges, i, column, scratch):
    """Shortens the ranges of the beams that passed so near by a corner that single precision could not tell the side.

    Args:
        seen: `seen_from`.
        part: as in `set_out`.
    """
    first, count, at = part
    u, v, cosine, sine = seen
    for k in range(count):
        if whole(scratch[_AT.along + np.uint64(at + k)]) == _UNSURE:
            way = way_of(beams, first + k, cosine, sine)
            look_along(frame, cells, (u, v), way, ranges, i, np.uint64(column + first + k))


@inlined
def scan_grids(frames, cells, states, which, reach, lidar, ranges, column):
    """Runs `scan_grid` for some robots, as many at once as go together.

    Where a robot's clearance tells that nothing of its grid is in reach, no beam is looked along.

    Args:
        frames, cells: Grids.
        states: records of the robots.
        which: which robots are not meant (b,), the first that may be, and the one behind the last.
        reach: m, of the hull in every direction, from where the clearance counts.
        lidar: sensing.Lidar.
    """
    count = lidar.beams.shape[1]
    if count == 0:
        return
    wide = (count + BESIDE - 1) // BESIDE * BESIDE
    held = 0
    skip, first, last = which
    for i in range(first, last):
        if skip[i]:
            continue
        s = states[i]
        frame = frames[s.scenario]
        if not s.clearance + reach < lidar.max_range:
            continue
        pose = (s.x, s.y, s.heading)
        if wide > TOGETHER:
            scan_grid(frame, cells, pose, lidar.beams, ranges, i, column, lidar.ways, lidar.words)
            continue
        part = 0, count, held * wide
        seen = seen_from(frame, pose)
        if set_out(frame, cells, seen, lidar.beams, part, ranges, i, column, lidar.ways, lidar.words):
            lidar.words[np.uint64(_HELD + held)] = i
            for k in range(4):
                lidar.scratch[np.uint64(4 * held + k)] = seen[k]
            held += 1
        if (held + 1) * wide > TOGETHER:
            land(frames, cells, states, lidar, ranges, column, held)
            held = 0
    if held > 0:
        land(frames, cells, states, lidar, ranges, column, held)


@compiled
def land(frames, cells, states, lidar, ranges, column, held):
    """Brings the beams of the first robots that are held to their ends."""
    count = lidar.beams.shape[1]
    wide = (count + BESIDE - 1) // BESIDE * BESIDE
    travel(cells, lidar.ways, lidar.words, held * wide)
    for k in range(held):
        i = np.int64(lidar.words[np.uint64(_HELD + k)])
        at = np.uint64(4 * k)
        seen = lidar.scratch[at], lidar.scratch[at + 1], lidar.scratch[at + 2], lidar.scratch[at + 3]
        frame = frames[states[i].scenario]
        arrive(frame, cells, seen, lidar.beams, (0, count, k * wide), ranges, i, column, lidar.ways)


@inlined
def travel(cells, scratch, words, count):
    """Lets all beams leap until the last has ended; those beside each other that all have ended are passed over."""
    left = np.uint64((count + BESIDE - 1) // BESIDE)
    for k in range(left):
        words[k] = k
    while left > 0:
        # one after the other: what has just been written here and there cannot be read at once
        for k in range(left):
            leap(scratch, words[k] * np.uint64(BESIDE))
        going = np.uint64(0)
        for k in range(left):
            which = words[k]
            rooms = look(cells, scratch, which * np.uint64(BESIDE), words[np.uint64(_FIRST) + which])
            words[going] = which
            going += np.uint64(1) if rooms != 0 else np.uint64(0)
        left = going


@inlined
def look(cells, scratch, first, begin):
    """Writes the rooms of BESIDE beams where `leap` said, in the grid that begins there; returns 0 if all are 0."""
    rooms = np.uint64(0)
    for k in range(np.uint64(BESIDE)):
        room = np.uint64(cells[begin + np.uint64(whole(scratch[_AT.room + first + k]))])
        scratch[_AT.room + first + k] = bits(np.int32(room))
        rooms |= room
    return rooms


@inlined
def leap(scratch, first):
    """Lets BESIDE beams go on to where they leave the squares that they are in; one whose room is 0 stays.

    Instead of a beam's room, it writes where to look for the next: that takes the same place.

    A beam rises by no more than it goes along: at the far end of a square it is at most one row beyond it, and then it
    left through the last column.
    """
    for j in range(np.uint64(BESIDE)):
        k = first + j
        room = whole(scratch[_AT.room + k])
        along = np.int32(whole(scratch[_AT.along + k]) + room)
        aside = whole(scratch[_AT.aside + k])
        at = np.float32(along) * scratch[_AT.slope + k] + scratch[_AT.start + k]
        to_aside = np.int32(at)
        part = at - np.float32(to_aside)
        sure = abs(part - _HALF) < scratch[_AT.sure + k]
        moves = room != 0
        beyond = moves & (to_aside >= np.int32(aside + room))
        to_along = np.int32(along - (np.int32(1) if beyond else np.int32(0)))
        to_aside = to_aside if moves else aside
        place = whole(scratch[_AT.here + k])
        place += to_along * whole(scratch[_AT.step_along + k]) + to_aside * whole(scratch[_AT.step_aside + k])
        # where the first cell of the rim is, there is no room either
        goes = sure & (to_along < whole(scratch[_AT.last + k])) & moves
        scratch[_AT.room + k] = bits(np.int32(place) if goes else np.int32(0))
        scratch[_AT.along + k] = bits(_UNSURE if moves & (not sure) else to_along)
        scratch[_AT.aside + k] = bits(to_aside)


@inlined
def stop_inside(frame, u, v, scratch, at, count):
    """Marks the beams that have ended on the rim of a grid, beyond which all is free."""
    j = np.int64(math.floor(u))
    i = np.int64(math.floor(v))
    for k in range(np.uint64(at), np.uint64(at + count)):
        along = whole(scratch[_AT.along + k])
        aside = whole(scratch[_AT.aside + k])
        step_along = whole(scratch[_AT.step_along + k])
        step_aside = whole(scratch[_AT.step_aside + k])
        # a row is at least three places long, with its rim
        swap = abs(step_along) > 1
        at_u = aside * step_aside if swap else along * step_along
        at_v = along if swap else aside
        column = j + at_u
        row = i + (at_v if (step_along if swap else step_aside) > 0 else -at_v)
        # without a branch, as all here
        inside = (column >= 0) & (column < frame.grid_columns) & (row >= 0) & (row < frame.grid_rows)
        scratch[_AT.along + k] = bits(along if inside | (along == _UNSURE) else _OUT)
