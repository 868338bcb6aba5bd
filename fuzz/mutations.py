"""Mutations that know a little of what they damage."""

from __future__ import annotations

import gzip
import io
import re
import struct
import zipfile

import numpy as np

NUMBERS = [0, 1, 2, 3, 7, 8, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1]
NUMBERS += [2**32, 2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1, 10**9, 10**12, 0x3FB99999]
WORDS = ["nan", "-nan(ind)", "inf", "-1", "0", "1e308", "1e400", "NA", "", '"', "1.0D+00", "x", "#"]
WORDS += ["list", "uchar", "float", "element", "property", "end_header", "COUNT", "DATA", "[", "{"]

TEXT = (".ply", ".pcd", ".xyz", ".pts", ".csv", ".txt", ".asc", ".ptx", ".world", ".wbt")
E57_PAGE = 1024


def mutated(suffix: str, content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """A damaged copy of a file; `other` is one of the same format."""
    if suffix.endswith(".gz") and rng.random() < 0.7:
        return gzip.compress(_damaged(".xyz", gzip.decompress(content), b"1 2\n", rng))
    if suffix in (".npz", ".scan") and rng.random() < 0.6:
        return _member_mutated(content, rng)
    result = _damaged(suffix, content, other, rng)
    if suffix == ".e57" and rng.random() < 0.9:
        result = with_checksums(result)
    return result


def _damaged(suffix: str, content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    for _ in range(int(rng.integers(1, 5))):
        ways = [_bits, _bytes, _number, _number_in_head, _cut, _without, _twice, _spliced]
        if suffix in TEXT:
            ways += [_word, _word, _word, _line, _line, _nested]
        content = ways[int(rng.integers(len(ways)))](content, other, rng) or b"\0"
    return content


def _bits(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    raw = bytearray(content)
    raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(8))
    return bytes(raw)


def _bytes(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    at, n = int(rng.integers(len(content))), int(rng.integers(1, 9))
    return content[:at] + rng.bytes(n) + content[at + n :]


def _number(content: bytes, _: bytes, rng: np.random.Generator, most: int | None = None) -> bytes:
    size = int(rng.choice([1, 2, 4, 8]))
    at = int(rng.integers(min(len(content), most or len(content))))
    if rng.random() < 0.15:
        part = struct.pack("<d", rng.choice([0.0, np.nan, np.inf, 1e308, -1e-308, 1e19]))
    else:
        value = NUMBERS[int(rng.integers(len(NUMBERS)))] & (256**size - 1)
        part = value.to_bytes(size, "little" if rng.random() < 0.9 else "big")
    return content[:at] + part + content[at + len(part) :]


def _number_in_head(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    return _number(content, other, rng, 420)


def _cut(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _without(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    at, n = int(rng.integers(len(content))), int(rng.integers(1, 64))
    return content[:at] + content[at + n :]


def _twice(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    at, n = int(rng.integers(len(content))), int(rng.integers(1, 256))
    return content[: at + n] * int(rng.integers(1, 3)) + content[at:]


def _spliced(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))] + other[int(rng.integers(len(other))) :]


def _word(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    places = list(re.finditer(rb"[^\s,;:\[\]{}]+", content[:4000]))
    if not places:
        return content
    place = places[int(rng.integers(len(places)))]
    words = WORDS if rng.random() < 0.5 else [str(number) for number in NUMBERS]
    return content[: place.start()] + rng.choice(words).encode() + content[place.end() :]


def _line(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    i, k = rng.integers(len(lines), size=2)
    match int(rng.integers(4)):
        case 0:
            del lines[i]
        case 1:
            lines.insert(k, lines[i])
        case 2:
            lines[i], lines[k] = lines[k], lines[i]
        case _:
            lines[i] = lines[i] * int(rng.integers(0, 30))
    return b"\n".join(lines)


def _nested(content: bytes, _: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(content)))
    return content[:at] + rng.choice([b"[", b'{"a":', b"("]) * 3000 + content[at:]


def _member_mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """An archive that is whole, with a damaged array in it."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = list(members)[int(rng.integers(len(members)))]
    members[name] = _damaged(".ply", members[name], b"\x93NUMPY", rng)
    result = io.BytesIO()
    with zipfile.ZipFile(result, "w", zipfile.ZIP_DEFLATED) as archive:
        for each, data in members.items():
            archive.writestr(each, data)
    return result.getvalue()


def _crc_table() -> list[int]:
    table = []
    for n in range(256):
        for _ in range(8):
            n = n >> 1 ^ (0x82F63B78 if n & 1 else 0)
        table.append(n)
    return table


_TABLE = _crc_table()


def with_checksums(content: bytes) -> bytes:
    """An E57 file whose pages have their checksums (CRC-32C), and whose header has its size."""
    raw = bytearray(content)
    if len(raw) >= 24 and len(raw) % E57_PAGE == 0:
        raw[16:24] = len(raw).to_bytes(8, "little")
    for start in range(0, len(raw) - E57_PAGE + 1, E57_PAGE):
        crc = 0xFFFFFFFF
        for byte in raw[start : start + E57_PAGE - 4]:
            crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 255]
        raw[start + E57_PAGE - 4 : start + E57_PAGE] = (crc ^ 0xFFFFFFFF).to_bytes(4, "big")
    return bytes(raw)
