"""Decodes an LVX 1.1 recording with nothing but the standard library, by the public description of the format.

One line for each packet, `stamp data_type values...`: integers as they stand in the file (millimetres, 0.01 degrees), an
IMU's floats by their repr.
"""
import struct
import sys

# By data type: layout of a record, records in a packet.
RECORDS = {
    0: ("<iiiB", 100), 1: ("<IHHB", 100), 2: ("<iiiBB", 96), 3: ("<IHHBB", 96), 4: ("<iiiBBiiiBB", 48),
    5: ("<HHIBBIBB", 48), 6: ("<6f", 1), 7: ("<iiiBBiiiBBiiiBB", 30), 8: ("<HHIBBIBBIBB", 30),
}

data = open(sys.argv[1], "rb").read()
assert data[:10] == b"livox_tech" and data[16:18] == b"\1\1"
frame = 29 + 59 * data[28]
while frame < len(data):
    current, following, _ = struct.unpack_from("<QQQ", data, frame)
    assert current == frame
    packet = frame + 24
    while packet < following:
        # Device, version, slot, id, reserved, status, source of time, data type, stamp.
        data_type, stamp = struct.unpack_from("<BQ", data, packet + 10)
        layout, count = RECORDS[data_type]
        size = struct.calcsize(layout)
        records = data[packet + 19:packet + 19 + count * size]
        values = [value for record in struct.iter_unpack(layout, records) for value in record]
        print(stamp, data_type, *map(repr, values))
        packet += 19 + count * size
    frame = following
