"""Connected superpixels from a label image: union-find over runs, small pieces joined to a neighbour."""

from __future__ import annotations

import numpy as np
from numba import njit

_HASH_SLOTS = 8192


@njit(cache=True, nogil=True)
def _find(parent, i):  # type: ignore[no-untyped-def]
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def _runs(index, gap_px):  # type: ignore[no-untyped-def]
    """Return the first column of each run of equal labels and the first run of each row (H + 1,).

    A run of up to `gap_px` pixels between two of the same label becomes part of them: the grain of noisy borders.
    """
    height, width = index.shape
    first_run = np.empty(height + 1, np.int32)
    start = np.empty(height * width, np.int16)
    n = 0
    for y in range(height):
        first_run[y] = n
        start[n] = 0
        n += 1
        label = index[y, 0]
        before = np.int32(-1)
        for x in range(1, width):
            if index[y, x] != label:
                if index[y, x] == before and x - start[n - 1] <= gap_px:
                    n -= 1
                    before = index[y, start[n - 2]] if n - 2 >= first_run[y] else np.int32(-1)
                else:
                    start[n] = x
                    n += 1
                    before = label
                label = index[y, x]
    first_run[height] = n
    return start[:n], first_run


@njit(cache=True, nogil=True)
def _components(index, start, first_run):  # type: ignore[no-untyped-def]
    """Return the 4-connected component of each run, numbered in raster order, and the number of them."""
    height, width = index.shape
    n = len(start)
    parent = np.arange(n)
    for y in range(1, height):
        up, up_end = first_run[y - 1], first_run[y]
        for run in range(first_run[y], first_run[y + 1]):
            x0 = start[run]
            x1 = start[run + 1] if run + 1 < first_run[y + 1] else width
            while True:
                up_x1 = start[up + 1] if up + 1 < up_end else width
                if index[y, x0] == index[y - 1, start[up]]:
                    a, b = _find(parent, up), _find(parent, run)
                    parent[max(a, b)] = min(a, b)
                if up_x1 >= x1:
                    if up_x1 == x1:
                        up += 1
                    break
                up += 1
    component = np.empty(n, np.int32)
    count = 0
    for run in range(n):
        root = _find(parent, run)
        if root == run:
            component[run] = count
            count += 1
        else:
            component[run] = component[root]
    return component, count


@njit(cache=True, nogil=True)
def _borders(component, count, start, first_run, width, row_px, height):  # type: ignore[no-untyped-def]
    """Return the pixels of each component and its borders: (first, neighbour, length), three lists by component.

    A border shows up once per stretch; a neighbour may be listed more than once.
    """
    n = len(start)
    size, degree = np.zeros(count, np.int32), np.zeros(count + 1, np.int32)
    pairs = np.empty((3 * n + 1, 3), np.int32)
    pairs[0] = -1
    last = np.zeros(_HASH_SLOTS, np.int32)
    m = 0
    for y in range(len(first_run) - 1):
        thick = min(row_px, height - y * row_px)  # rows of the frame that this one stands for
        up = first_run[y - 1] if y > 0 else 0
        up_end = first_run[y]
        for run in range(first_run[y], first_run[y + 1]):
            x0 = start[run]
            x1 = start[run + 1] if run + 1 < first_run[y + 1] else width
            c = component[run]
            size[c] += (x1 - x0) * thick
            if x0 > 0:
                m = _add_pair(pairs, m, component[run - 1], c, thick, degree, last)
            while y > 0:
                up_x0 = start[up]
                up_x1 = start[up + 1] if up + 1 < up_end else width
                if component[up] != c:
                    m = _add_pair(pairs, m, component[up], c, min(x1, up_x1) - max(x0, up_x0), degree, last)
                if up_x1 >= x1:
                    if up_x1 == x1:
                        up += 1
                    break
                up += 1
    first = np.zeros(count + 1, np.int32)
    for c in range(count):
        first[c + 1] = first[c] + degree[c]
    fill = first[:-1].copy()
    neighbour, length = np.empty(2 * m, np.int32), np.empty(2 * m, np.int32)
    for i in range(m):
        a, b, overlap = pairs[i]
        neighbour[fill[a]], length[fill[a]] = b, overlap
        fill[a] += 1
        neighbour[fill[b]], length[fill[b]] = a, overlap
        fill[b] += 1
    return size, first, neighbour, length


@njit(cache=True, nogil=True)
def _add_pair(pairs, m, a, b, overlap, degree, last):  # type: ignore[no-untyped-def]
    """Append a border or lengthen the one of the same pair that was seen last at its place in a small hash table."""
    slot = (a * 31 + b) & (len(last) - 1)
    at = last[slot]
    if pairs[at, 0] == a and pairs[at, 1] == b:
        pairs[at, 2] += overlap
        return m
    pairs[m, 0], pairs[m, 1], pairs[m, 2] = a, b, overlap
    last[slot] = m
    degree[a] += 1
    degree[b] += 1
    return m + 1


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
    start, first_run = _runs(index, gap_px)
    component, pieces = _components(index, start, first_run)
    size, first, neighbour, length = _borders(component, pieces, start, first_run, width, row_px, height)
    target = _join_small(size, first, neighbour, length, min_pixels)
    ids = np.full(pieces, -1, np.int32)
    count = 0
    for piece in range(pieces):
        if ids[target[piece]] < 0:
            ids[target[piece]] = count
            count += 1
        ids[piece] = ids[target[piece]]
    connected = np.empty((rows, width), np.int32)
    for y in range(rows):
        for run in range(first_run[y], first_run[y + 1]):
            x1 = start[run + 1] if run + 1 < first_run[y + 1] else width
            label = ids[component[run]]
            for x in range(start[run], x1):
                connected[y, x] = label
    pairs, overlap = np.empty((len(neighbour) // 2, 2), np.int32), np.empty(len(neighbour) // 2, np.int32)
    m = 0
    for piece in range(pieces):
        for i in range(first[piece], first[piece + 1]):
            if piece < neighbour[i] and ids[piece] != ids[neighbour[i]]:  # each border is in the lists of both
                pairs[m, 0], pairs[m, 1], overlap[m] = piece, neighbour[i], length[i]
                m += 1
    edges, edge_length = regroup_edges(pairs[:m], overlap[:m], ids, count)
    return connected, edges, edge_length


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
def expand(index, ids, count, row_px, height):  # type: ignore[no-untyped-def]
    """Return the label image at its full `height`, labels replaced by ids, and the pixels, sum x, sum y of each id."""
    rows, width = index.shape
    full = np.empty((height, width), np.int32)
    moments = np.zeros((count, 3))
    for row in range(rows):
        y0, y1 = row * row_px, min(height, (row + 1) * row_px)
        x0 = 0
        while x0 < width:
            x1 = x0 + 1
            while x1 < width and index[row, x1] == index[row, x0]:
                x1 += 1
            k = ids[index[row, x0]]
            moments[k, 0] += (x1 - x0) * (y1 - y0)
            moments[k, 1] += (x1 - x0) * (y1 - y0) * (x0 + x1 - 1) * 0.5
            moments[k, 2] += (x1 - x0) * (y1 - y0) * (y0 + y1 - 1) * 0.5
            x0 = x1
        for x in range(width):
            full[y0, x] = ids[index[row, x]]
        for y in range(y0 + 1, y1):
            full[y] = full[y0]
    return full, moments
