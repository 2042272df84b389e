"""Rows of a PNG, as its filters are undone (PNG specification, section 9)."""


def unfiltered_rows(data, height, stride, channels):
    """The rows of decompressed image data, `stride` bytes each, of `channels` bytes a pixel (1 where a pixel is less)."""
    above = bytes(stride)
    for y in range(height):
        start = y * (stride + 1)
        method, line = data[start], bytearray(data[start + 1:start + 1 + stride])
        if method == 1:
            for x in range(channels, stride):
                line[x] = (line[x] + line[x - channels]) & 255
        elif method == 2:
            line = bytearray((byte + up) & 255 for byte, up in zip(line, above))
        elif method == 3:
            for x in range(stride):
                left = line[x - channels] if x >= channels else 0
                line[x] = (line[x] + (left + above[x]) // 2) & 255
        elif method == 4:
            # left of the first pixel is nothing: the nearest is the one above
            for x in range(channels):
                line[x] = (line[x] + above[x]) & 255
            for x in range(channels, stride):
                left, up, corner = line[x - channels], above[x], above[x - channels]
                to_left, to_up = up - corner, left - corner
                to_corner = abs(to_left + to_up)
                to_left, to_up = abs(to_left), abs(to_up)
                nearest = left if to_left <= to_up and to_left <= to_corner else up if to_up <= to_corner else corner
                line[x] = (line[x] + nearest) & 255
        above = bytes(line)
        yield above
