"""OME-Zarr of Zarr 3, sharded too, from its specification: Debian has no library that writes it."""
import itertools
import json
import os

import numcodecs
import numpy as np

from common import run
from volumes import expect_placed, expect_same, raw_of, read_bytes, voxels, write_bytes


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return (crc ^ 0xFFFFFFFF).to_bytes(4, "little")


def write_zarr3(folder, values, chunk, shard=None, order=None, endian="little", codec=None,
                checksum=False, index_location="end", separator="/"):
    """An array; its fill value is 0."""
    pack = {None: lambda b: b, "gzip": numcodecs.GZip().encode, "zstd": numcodecs.Zstd().encode,
            "blosc": numcodecs.Blosc("lz4").encode}[codec]
    codecs = []
    if order:
        codecs.append({"name": "transpose", "configuration": {"order": order}})
    codecs.append({"name": "bytes", "configuration": {"endian": endian}})
    if codec:
        codecs.append({"name": codec, "configuration": {}})
    if checksum:
        codecs.append({"name": "crc32c"})

    def block(index, size):
        full = np.zeros(size, values.dtype)
        part = values[tuple(slice(i * n, (i + 1) * n) for i, n in zip(index, size))]
        full[tuple(slice(0, n) for n in part.shape)] = part
        return full

    def packed(full):
        if order:
            full = full.transpose(order)
        kind = full.dtype.newbyteorder("<" if endian == "little" else ">")
        data = bytes(pack(np.ascontiguousarray(full.astype(kind)).tobytes()))
        return data + crc32c(data) if checksum else data

    outer = shard or chunk
    counts = [-(-n // size) for n, size in zip(values.shape, outer)]
    for index in itertools.product(*(range(n) for n in counts)):
        full = block(index, outer)
        if not full.any():
            continue  # missing: the fill value
        data = b""
        if shard:
            inner = [n // size for n, size in zip(shard, chunk)]
            index_bytes = int(np.prod(inner)) * 16 + 4
            start = index_bytes if index_location == "start" else 0
            table = b""
            for at in itertools.product(*(range(n) for n in inner)):
                part = full[tuple(slice(i * n, (i + 1) * n) for i, n in zip(at, chunk))]
                if not part.any():
                    table += b"\xff" * 16
                    continue
                one = packed(part)
                table += (start + len(data)).to_bytes(8, "little") + len(one).to_bytes(8, "little")
                data += one
            table += crc32c(table)
            data = table + data if index_location == "start" else data + table
        else:
            data = packed(full)
        path = f"{folder}/c{separator}" + separator.join(str(i) for i in index)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        write_bytes(path, data)
    if shard:
        codecs = [{"name": "sharding_indexed", "configuration": {
            "chunk_shape": chunk, "codecs": codecs, "index_location": index_location,
            "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}],
        }}]
    with open(f"{folder}/zarr.json", "w") as file:
        json.dump({
            "zarr_format": 3, "node_type": "array", "shape": values.shape,
            "data_type": values.dtype.name, "fill_value": 0, "codecs": codecs, "attributes": {},
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": outer}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": separator}},
        }, file)


def test_codecs_orders_shards_and_checksums_are_read():
    values = voxels("i16", (9, 33, 29))
    values[:4, :16, :16] = 0
    for number, options in enumerate((
        {}, {"codec": "gzip"}, {"codec": "zstd", "checksum": True}, {"codec": "blosc"},
        {"order": [2, 0, 1]}, {"endian": "big", "separator": "."}, {"checksum": True},
        {"shard": [8, 32, 32]}, {"shard": [8, 32, 32], "codec": "zstd", "checksum": True},
        {"shard": [4, 16, 32], "index_location": "start", "order": [1, 2, 0], "codec": "gzip"},
    )):
        store = f"three{number}.zarr"
        os.makedirs(f"{store}/0")
        write_zarr3(f"{store}/0", values, [4, 16, 16], **options)
        with open(f"{store}/zarr.json", "w") as file:
            json.dump({"zarr_format": 3, "node_type": "group", "attributes": {"ome": {
                "version": "0.5", "multiscales": [{
                    "axes": [{"name": n, "type": "space"} for n in "zyx"],
                    "datasets": [{"path": "0", "coordinateTransformations": [
                        {"type": "scale", "scale": [3, 2, 1]}]}]}]}}}, file)
        found, about = raw_of(store)
        expect_same(found, values)
        expect_placed(about, spacing=[1, 2, 3], origin=[0, 0, 0])


def test_no_byte_of_an_index_of_a_shard_is_trusted():
    os.makedirs("shard.zarr")
    write_zarr3("shard.zarr", voxels("i16", (9, 33, 29)), [4, 16, 16], shard=[4, 16, 32],
                index_location="start", order=[1, 2, 0], codec="gzip")
    shard = "shard.zarr/c/0/0/0"
    whole = read_bytes(shard)
    for at in range(0, 36):  # two rows and their checksum
        write_bytes(shard, whole[:at], bytes([whole[at] ^ 0x40]), whole[at + 1 :])
        run("convert", "shard.zarr", "-o", "x.raw", fails_with=shard)
    for length in range(0, len(whole), max(1, len(whole) // 10)):
        write_bytes(shard, whole[:length])
        run("convert", "shard.zarr", "-o", "x.raw", fails_with=shard)
