"""UDP payloads of a classic pcap capture."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

_GLOBAL_HEADER = 24
_ORDERS = {
    b"\xd4\xc3\xb2\xa1": "<",
    b"\x4d\x3c\xb2\xa1": "<",
    b"\xa1\xb2\xc3\xd4": ">",
    b"\xa1\xb2\x3c\x4d": ">",
}
_ETHERNET = 1
_IPV4 = b"\x08\x00"
_UDP = 17


def udp_payloads(path: Path) -> Iterator[bytes]:
    """Yields the payload of every unfragmented IPv4 UDP datagram, in the order of capture.

    Raises ValueError where the file is no pcap capture of an Ethernet interface, or ends inside a packet.
    """
    with open(path, "rb") as file:
        header = file.read(_GLOBAL_HEADER)
        order = _ORDERS.get(header[:4])
        if order is None or len(header) < _GLOBAL_HEADER:
            raise ValueError(f"{path} is no pcap capture")
        link = struct.unpack_from(order + "I", header, 20)[0]
        if link != _ETHERNET:
            raise ValueError(f"{path} has link type {link}, not Ethernet")
        record = struct.Struct(order + "IIII")
        while True:
            head = file.read(record.size)
            if not head:
                return
            if len(head) < record.size:
                raise ValueError(f"{path} ends inside a packet")
            length = record.unpack(head)[2]
            packet = file.read(length)
            if len(packet) < length:
                raise ValueError(f"{path} ends inside a packet")
            payload = _udp_payload(packet)
            if payload is not None:
                yield payload


def _udp_payload(packet: bytes) -> bytes | None:
    """The UDP payload of an Ethernet frame, None for anything else."""
    if packet[12:14] != _IPV4 or len(packet) < 34 or packet[23] != _UDP:
        return None
    fragment = struct.unpack_from(">H", packet, 20)[0]
    if fragment & 0x3FFF:
        return None
    start = 14 + 4 * (packet[14] & 0x0F)
    if len(packet) < start + 8:
        return None
    length = struct.unpack_from(">H", packet, start + 4)[0]
    return packet[start + 8 : start + length]
