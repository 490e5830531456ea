"""Connected superpixels from a label image: union-find over runs, small pieces joined to a neighbour."""

from __future__ import annotations

import numpy as np
from numba import njit

_HASH_SLOTS = 8192

_AT_ONCE = 8
"""Pixels of a run that are painted at a time."""


@njit(cache=True, nogil=True)
def _find(parent, i):  # type: ignore[no-untyped-def]
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def _runs(index, gap_px):  # type: ignore[no-untyped-def]
    """Return first column, end and label of each run of equal labels, and the first run of each row (H + 1,).

    A run of up to `gap_px` pixels between two of the same label becomes part of them: the grain of noisy borders.
    """
    height, width = index.shape
    first_run = np.empty(height + 1, np.int32)
    start, stop = np.empty(height * width, np.int32), np.empty(height * width, np.int32)
    labels = np.empty(height * width, np.int32)
    change = np.empty(width + 1, np.int32)
    n = 0
    for y in range(height):
        first_run[y] = n
        changes = _changes(index[y], change)
        for c in range(changes):
            label = index[y, change[c]]
            if n - first_run[y] >= 2 and label == labels[n - 2] and change[c] - start[n - 1] <= gap_px:
                n -= 1
            else:
                start[n], labels[n] = change[c], label
                n += 1
            stop[n - 1] = change[c + 1]
    first_run[height] = n
    return start[:n], stop[:n], labels[:n], first_run


@njit(cache=True, nogil=True)
def _changes(row, change):  # type: ignore[no-untyped-def]
    """Write where the labels of a row change, 0 and its length included; return the number of runs. No branches."""
    change[0], n = 0, 1
    for x in range(1, len(row)):
        change[n] = x
        n += int(row[x] != row[x - 1])
    change[n] = len(row)
    return n


@njit(cache=True, nogil=True)
def _overlaps(start, stop, labels, first_run):  # type: ignore[no-untyped-def]
    """Return the runs that lie one above the other, (n, 2) of the same label and (m, 2) of unlike ones, and how many
    pixels long the borders of these are (m,).

    Which of the two lists a pair belongs to, no processor can guess: it is written to both, and counts in one.
    """
    n = len(start)
    same, unlike = np.empty((2 * n + 1, 2), np.int32), np.empty((2 * n + 1, 2), np.int32)
    length = np.empty(2 * n + 1, np.int32)
    n_same, n_unlike = 0, 0
    for y in range(1, len(first_run) - 1):
        up, run, last = first_run[y - 1], first_run[y], first_run[y + 1]
        while run < last:
            alike = int(labels[up] == labels[run])
            same[n_same, 0], same[n_same, 1] = up, run
            unlike[n_unlike, 0], unlike[n_unlike, 1] = up, run
            length[n_unlike] = min(stop[up], stop[run]) - max(start[up], start[run])
            n_same += alike
            n_unlike += 1 - alike
            run_ends, up_ends = stop[run] <= stop[up], stop[up] <= stop[run]
            run += int(run_ends)
            up += int(up_ends)
    return same[:n_same], unlike[:n_unlike], length[:n_unlike]


@njit(cache=True, nogil=True)
def _components(same, n):  # type: ignore[no-untyped-def]
    """Return the 4-connected component of each of n runs, numbered in raster order, and the number of them."""
    parent = np.arange(n).astype(np.int32)
    for i in range(len(same)):
        a, b = _find(parent, same[i, 0]), _find(parent, same[i, 1])
        parent[max(a, b)] = min(a, b)
    component = np.empty(n, np.int32)
    count = 0
    for run in range(n):
        if parent[run] == run:
            component[run] = count
            count += 1
        else:  # a parent comes before its children
            component[run] = component[parent[run]]
    return component, count


@njit(cache=True, nogil=True)
def _borders(component, count, start, stop, first_run, unlike, overlap, row_px, height):  # type: ignore[no-untyped-def]
    """Return the pixels of each component, and the pairs of components that touch, (m, 2), with the lengths of their
    borders (m,).

    A pair may be listed more than once, with a part of its border each time.
    """
    size, last = np.zeros(count, np.int32), np.zeros(_HASH_SLOTS, np.int32)
    most = len(unlike) + len(start) + 1
    pairs, length = np.empty((most, 2), np.int32), np.empty(most, np.int32)
    pairs[0] = -1
    m = 0
    for y in range(len(first_run) - 1):
        thick = min(row_px, height - y * row_px)  # rows of the frame that this one stands for
        for run in range(first_run[y], first_run[y + 1]):
            size[component[run]] += (stop[run] - start[run]) * thick
            if run > first_run[y]:
                m = _add_pair(pairs, length, m, component[run - 1], component[run], thick, last)
    for i in range(len(unlike)):
        m = _add_pair(pairs, length, m, component[unlike[i, 0]], component[unlike[i, 1]], overlap[i], last)
    return size, pairs[:m], length[:m]


@njit(cache=True, nogil=True)
def _add_pair(pairs, length, m, a, b, overlap, last):  # type: ignore[no-untyped-def]
    """Append a border or lengthen the one of the same pair that was seen last at its place in a small hash table."""
    a, b = min(a, b), max(a, b)
    slot = (a * 31 + b) & (_HASH_SLOTS - 1)
    at = last[slot]
    if pairs[at, 0] == a and pairs[at, 1] == b:
        length[at] += overlap
        return m
    pairs[m, 0], pairs[m, 1], length[m] = a, b, overlap
    last[slot] = m
    return m + 1


@njit(cache=True, nogil=True)
def _by_component(pairs, pair_length, count):  # type: ignore[no-untyped-def]
    """Return the borders as three lists by component: (first, neighbour, length)."""
    first = np.zeros(count + 1, np.int32)
    for i in range(len(pairs)):
        first[pairs[i, 0] + 1] += 1
        first[pairs[i, 1] + 1] += 1
    for c in range(count):
        first[c + 1] += first[c]
    fill = first[:-1].copy()
    neighbour, length = np.empty(2 * len(pairs), np.int32), np.empty(2 * len(pairs), np.int32)
    for i in range(len(pairs)):
        for side in range(2):
            a = pairs[i, side]
            neighbour[fill[a]], length[fill[a]] = pairs[i, 1 - side], pair_length[i]
            fill[a] += 1
    return first, neighbour, length


@njit(cache=True, nogil=True)
def _join_small(size, first, neighbour, length, min_pixels):  # type: ignore[no-untyped-def]
    """Return the component that each component ends in: small ones join the neighbour of the longest border."""
    count = len(size)
    parent = np.arange(count)
    size = size.copy()
    next_member = np.full(count, -1)
    last_member = np.arange(count)
    tally = np.zeros(count, np.int64)
    for c in range(count):
        while size[_find(parent, c)] < min_pixels:
            root = _find(parent, c)
            best, longest = -1, 0
            for sweep in range(2):  # the second sweep clears the tally
                member = root
                while member >= 0:
                    for i in range(first[member], first[member + 1]):
                        other = _find(parent, neighbour[i])
                        if other == root:
                            continue
                        if sweep == 1:
                            tally[other] = 0
                            continue
                        tally[other] += length[i]
                        if tally[other] > longest or (tally[other] == longest and other < best):
                            best, longest = other, tally[other]
                    member = next_member[member]
            if best < 0:
                break
            parent[root] = best
            size[best] += size[root]
            next_member[last_member[best]] = root
            last_member[best] = last_member[root]
    for c in range(count):
        parent[c] = _find(parent, c)
    return parent


@njit(cache=True, nogil=True)
def connect(index, min_pixels, gap_px, row_px, height):  # type: ignore[no-untyped-def]
    """Return the label image made 4-connected and the neighbours in it; each row stands for `row_px` rows of `height`.

    Pieces below `min_pixels` join the neighbour with whom they share the longest border; before, stretches of a row of
    up to `gap_px` pixels that part a label from itself are given to it.

    Returns
    -------
    (rows, W) int32 ids 0.. in raster order, (E, 2) int32 pairs i < j ascending, (E,) int32 border lengths
    in pairs of 4-neighbouring pixels of the frame.
    """
    rows, width = index.shape
    start, stop, labels, first_run = _runs(index, gap_px)
    same, unlike, overlap = _overlaps(start, stop, labels, first_run)
    component, pieces = _components(same, len(start))
    size, pairs, length = _borders(component, pieces, start, stop, first_run, unlike, overlap, row_px, height)
    first, neighbour, shared = _by_component(pairs, length, pieces)
    target = _join_small(size, first, neighbour, shared, min_pixels)
    ids = np.full(pieces, -1, np.int32)
    count = 0
    for piece in range(pieces):
        if ids[target[piece]] < 0:
            ids[target[piece]] = count
            count += 1
        ids[piece] = ids[target[piece]]
    connected = _paint(start, stop, first_run, ids[component], rows, width)
    edges, edge_length = regroup_edges(pairs, length, ids, count)
    return connected, edges, edge_length


@njit(cache=True, nogil=True)
def _paint(start, stop, first_run, label, rows, width):  # type: ignore[no-untyped-def]
    """Return the image (rows, width) of runs, eight pixels at a time: the next run paints over what is too much."""
    flat = np.empty(rows * width + _AT_ONCE, np.int32)
    for y in range(rows):
        for run in range(first_run[y], first_run[y + 1]):
            x, end = y * width + start[run], y * width + stop[run]
            while x < end:
                for k in range(_AT_ONCE):
                    flat[x + k] = label[run]
                x += _AT_ONCE
    return flat[: rows * width].reshape((rows, width))


@njit(cache=True, nogil=True)
def regroup_edges(edges, edge_length, ids, count):  # type: ignore[no-untyped-def]
    """Return the edges between the new `ids` of their ends, i < j ascending, lengths of parallel ones added."""
    first = np.zeros(count + 1, np.int32)
    for e in range(len(edges)):
        a, b = ids[edges[e, 0]], ids[edges[e, 1]]
        if a != b:
            first[min(a, b) + 1] += 1
    for k in range(count):
        first[k + 1] += first[k]
    fill = first[:-1].copy()
    other, length = np.empty(first[count], np.int32), np.empty(first[count], np.int32)
    for e in range(len(edges)):
        a, b = ids[edges[e, 0]], ids[edges[e, 1]]
        if a != b:
            low = min(a, b)
            other[fill[low]], length[fill[low]] = max(a, b), edge_length[e]
            fill[low] += 1
    total = np.zeros(count, np.int32)
    grouped, grouped_length = np.empty((len(other), 2), np.int32), np.empty(len(other), np.int32)
    found = np.empty(count, np.int32)
    m = 0
    for a in range(count):
        k = 0
        for i in range(first[a], first[a + 1]):
            if total[other[i]] == 0:
                _insert(found, k, other[i])
                k += 1
            total[other[i]] += length[i]
        for b in found[:k]:
            grouped[m, 0], grouped[m, 1], grouped_length[m] = a, b, total[b]
            total[b] = 0
            m += 1
    return grouped[:m].copy(), grouped_length[:m].copy()


@njit(cache=True, nogil=True)
def _insert(ascending, k, value):  # type: ignore[no-untyped-def]
    """Insert into the first `k` numbers: a superpixel has few neighbours, and np.sort makes an array."""
    while k > 0 and ascending[k - 1] > value:
        ascending[k] = ascending[k - 1]
        k -= 1
    ascending[k] = value


@njit(cache=True, nogil=True)
def expand(index, ids, row_px, height):  # type: ignore[no-untyped-def]
    """Return the label image at its full `height`, labels replaced by ids."""
    rows, width = index.shape
    full = np.empty((height, width), np.int32)
    for row in range(rows):
        y = row * row_px
        for x in range(width):
            full[y, x] = ids[index[row, x]]
        for below in range(y + 1, min(height, y + row_px)):
            full[below] = full[y]
    return full


@njit(cache=True, nogil=True)
def moments_of_frame(sums, index, ids, row_px, height):  # type: ignore[no-untyped-def]
    """Return the pixels, sum x and sum y of each id at the full `height` (K, 3), given the sums of the thinned rows."""
    moments = np.empty((len(sums), 3))
    for k in range(len(sums)):
        n, x, y = sums[k, 0], sums[k, 1], sums[k, 2]
        moments[k, 0], moments[k, 1], moments[k, 2] = row_px * n, row_px * x, row_px * (y + n * (row_px - 1) * 0.5)
    for y in range(height, len(index) * row_px):  # rows beyond the frame that the last one does not stand for
        for x in range(index.shape[1]):
            k = ids[index[len(index) - 1, x]]
            moments[k, 0] -= 1
            moments[k, 1] -= x
            moments[k, 2] -= y
    return moments
