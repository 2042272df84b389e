"""Decompression bombs and headers that declare more data than the file holds: nested, sparse, long and deeply nested
files, each small on disk."""

import bz2
import gzip
import json
import pathlib
import shutil
import struct
import sys
import zlib

from volume_files import nrrd_header

MIB = 1 << 20


def zeros(mebibytes, member):
    """Many zeros, compressed; a member of 16 MiB is compressed once and repeated."""
    return member(bytes(16 * MIB)) * (mebibytes // 16)


def deflated(mebibytes):
    """A zlib stream of many zeros that breaks off."""
    begin = zlib.compressobj(9)
    piece = begin.compress(bytes(16 * MIB)) + begin.flush(zlib.Z_FULL_FLUSH)
    again = zlib.compressobj(9, zlib.DEFLATED, -15)
    return piece + (again.compress(bytes(16 * MIB)) + again.flush(zlib.Z_FULL_FLUSH)) * (mebibytes // 16 - 1)


def metaimage(sizes, more):
    return f"ObjectType = Image\nNDims = 3\nDimSize = {sizes}\nElementType = MET_UCHAR\n{more}\n".encode()


def nifti(nx, ny, nz, magic=b"n+1\0"):
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, nx, ny, nz, 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 2, 8)
    struct.pack_into("<8f", header, 76, 1, 1, 1, 1, 1, 1, 1, 1)
    struct.pack_into("<f", header, 108, 352 if magic == b"n+1\0" else 0)
    header[344:348] = magic
    return bytes(header)


def sparse(file, size):
    with open(file, "wb") as out:
        out.truncate(size)


def volumes(folder):
    """Writes volumes that are bombs; {name: file}."""
    files = {}

    def put(name, content):
        files[name] = folder / name
        files[name].write_bytes(content)

    # long: a header without the voxels that it promises, or with fewer
    put("raw.nrrd", nrrd_header("3000 3000 3000", "encoding: raw\n") + bytes(1000))
    put("axis.nrrd", nrrd_header("9223372036854775807 2 2", "encoding: raw\n") + bytes(1000))
    put("axes.nrrd", nrrd_header("99999 99999 99999", "encoding: gzip\n") + gzip.compress(bytes(1000)))
    put("text.nrrd", nrrd_header("3000 3000 3000", "encoding: ascii\n") + b"1 " * 1000)
    put("hex.nrrd", nrrd_header("3000 3000 3000", "encoding: hex\n") + b"00" * 1000)
    put("raw.mha", metaimage("3000 3000 3000", "ElementDataFile = LOCAL") + bytes(1000))
    put("raw.nii", nifti(3000, 3000, 3000) + bytes(1000))
    put("header.nrrd", nrrd_header("10 10 10", "# comment\n" * 2_000_000))
    put("keys.nrrd", nrrd_header("10 10 10", "".join(f"key{n}:={n}\n" for n in range(900_000))))
    put("layers.seg.nrrd", nrrd_header("60000 200 200 200", "encoding: gzip\nkinds: list domain domain domain\n"
                                "Segment0_ID:=a\n") + gzip.compress(bytes(MIB)))
    put("flat.seg.nrrd", nrrd_header("60000 1 1 1", "encoding: raw\nkinds: list domain domain domain\n"
                              "Segment0_ID:=a\n") + bytes(60000))
    ramp = zlib.compressobj(1, zlib.DEFLATED, 31)
    every = b"".join(ramp.compress(struct.pack("<65536H", *range(65536))) for _ in range(100)) + ramp.flush()
    put("values.seg.nrrd", nrrd_header("256 256 1 100", "encoding: gzip\nendian: little\nkinds: domain domain domain list\n"
                                "Segment0_ID:=a\n", "uint16") + every)
    # 1.25 GiB of zeros in 1.3 MB: as a scan four times as much
    full = zeros(1280, gzip.compress)
    put("full.nrrd", nrrd_header("1280 1024 1024", "encoding: gzip\n") + full)
    put("full.nii.gz", gzip.compress(nifti(1280, 1024, 1024)) + full)
    # what is promised may be had, and is not there; what follows is no voxels, and makes the file large enough
    rest = b"\x55" * 400_000
    put("short.nrrd", nrrd_header("1024 1024 192", "encoding: gzip\n") + zeros(160, gzip.compress) + rest)
    put("short.nii.gz", gzip.compress(nifti(1024, 1024, 192)) + zeros(160, gzip.compress) + rest)
    put("short.mha", metaimage("1024 1024 192", "CompressedData = True\nElementDataFile = LOCAL") + deflated(160) + rest)
    put("short.bz2.nrrd", nrrd_header("1024 1024 192", "encoding: bzip2\n") + bz2.compress(bytes(16 * MIB)) + rest)
    put("more.nrrd", nrrd_header("1024 1024 128", "encoding: gzip\n") + zeros(1280, gzip.compress))
    put("skip.nrrd", nrrd_header("10 10 10", "encoding: gzip\nbyte skip: 2000000000\n") + full)
    put("end.nrrd", nrrd_header("1024 1024 2000", "encoding: gzip\nbyte skip: -1\n") + full)
    # much more than is promised to be possible
    put("bzip2.nrrd", nrrd_header("2000 2000 2000", "encoding: bzip2\n") + bz2.compress(bytes(45_000_000), 9))
    put("deflate.mha", metaimage("2000 2000 2000", "CompressedData = True\nElementDataFile = LOCAL") + deflated(1280))
    # sparse: nothing on the disk
    files["sparse.nhdr"] = folder / "sparse.nhdr"
    files["sparse.nhdr"].write_bytes(nrrd_header("2000 2000 2000", "encoding: raw\ndata file: sparse.raw\n"))
    sparse(folder / "sparse.raw", 8_000_000_000)
    files["sparse.mhd"] = folder / "sparse.mhd"
    files["sparse.mhd"].write_bytes(metaimage("2000 2000 2000", "ElementDataFile = sparse.raw"))
    files["sparse.hdr"] = folder / "sparse.hdr"
    files["sparse.hdr"].write_bytes(nifti(2000, 2000, 2000, b"ni1\0"))
    sparse(folder / "sparse.img", 8_000_000_000)
    put("holes.nrrd", nrrd_header("2000 2000 2000", "encoding: raw\n"))
    with open(files["holes.nrrd"], "ab") as out:
        out.truncate(8_000_000_300)
    # nested: what is inside is compressed again
    put("nested.nii.gz", gzip.compress(gzip.compress(zeros(1280, gzip.compress))))
    put("nested.dat", gzip.compress(gzip.compress(gzip.compress(bytes(16 * MIB)))))
    return files


def texts(folder):
    """Tables, scenes and scripts; {name: file}."""
    files = {}

    def put(name, content):
        files[name] = folder / name
        files[name].write_text(content)

    put("deep.json", "[" * 15_000_000)
    put("objects.json", '{"a":' * 3_000_000)
    put("wide.json", "[" + "{}," * 5_000_000)
    put("keys.json", "{" + ",".join(f'"{n}":""' for n in range(1_000_000)) + "}")
    put("wide.csv", "value,name\n1," + '"' * 15_000_000)
    put("deep.toml", "a = " + "[" * 900_000)
    put("dotted.toml", ".".join(["a"] * 400_000) + " = 1\n")
    put("tables.toml", "".join(f"[t{n}]\n" for n in range(100_000)))
    return files


def recordings(folder, whole):
    """Recordings made of a whole one by another program (h5py); {name: file}."""
    import h5py
    import numpy

    files = {}

    def copy(name):
        files[name] = folder / name
        shutil.copy(whole, files[name])
        return h5py.File(files[name], "r+")

    def columns(group):
        return [(name, group[name]) for name in list(group) if isinstance(group[name], h5py.Dataset)]

    def lengthen(file, name, rows, chunk, fill=True):
        for key, data in columns(file[name]):
            shape, kind = (rows,) + data.shape[1:], data.dtype
            first = data[:1]
            del file[name][key]
            longer = file[name].create_dataset(key, shape, kind, chunks=(chunk,) + shape[1:], compression="gzip",
                                               compression_opts=9)
            if not fill:
                continue
            # one chunk is compressed, and stored as often as there are chunks
            block = numpy.zeros((chunk,) + shape[1:], kind)
            if len(first):
                block[:] = first[0]
            packed = zlib.compress(block.tobytes(), 9)
            for at in range(0, rows, chunk):
                longer.id.write_direct_chunk((at,) + (0,) * (len(shape) - 1), packed)

    ticks = ["ticks", "device0"]
    # bytes that no compression makes fewer, so that the file's size allows much
    noise = numpy.frombuffer(numpy.random.default_rng(1).bytes(11 * MIB), "u1")
    with copy("long.h5") as file:
        file["noise"] = noise
        for name in ticks:
            lengthen(file, name, 4_000_000, 50_000)
    with copy("longer.h5") as file:
        for name in ticks:
            lengthen(file, name, 1_000_000_000, 1000, fill=False)
    with copy("sparse.h5") as file:
        for name in ticks:
            lengthen(file, name, 10_000, 1000, fill=False)
    with copy("events.h5") as file:
        file["noise"] = noise
        lengthen(file, "events", 20_000_000, 50_000)
    with copy("names.h5") as file:
        group = file["structures"]
        for key in ["label", "colour", "name", "tissue"]:
            del group[key]
        count = 65536
        text = numpy.full(count, b"n" * 4096, "S4096")
        group.create_dataset("label", data=numpy.arange(count, dtype="<u2"))
        group.create_dataset("colour", data=numpy.zeros((count, 3), "u1"))
        for key in ["name", "tissue"]:
            group.create_dataset(key, data=text, chunks=(1024,), compression="gzip")
        file["noise"] = noise
    with copy("deep.h5") as file:
        group = file.create_group("deep")
        for _ in range(3000):
            group = group.create_group("g")
        del file["ticks"]
        file["ticks"] = h5py.SoftLink("/deep" + "/g" * 3000)
    with copy("loop.h5") as file:
        del file["ticks"]
        file["ticks"] = h5py.SoftLink("/ticks")
    with copy("outside.h5") as file:
        del file["ticks"]
        file["ticks"] = h5py.ExternalLink(str(whole), "/ticks")
    with copy("script.h5") as file:
        del file["header/script"]
        file["header"].create_dataset("script", data=numpy.bytes_(b"a" * (40 * MIB)))
    return files


if __name__ == "__main__":
    # in a process of their own, whose memory counts for nobody else: bombs.py KIND FOLDER [RECORDING]
    made = {"volumes": volumes, "texts": texts, "recordings": recordings}[sys.argv[1]](*map(pathlib.Path, sys.argv[2:]))
    print(json.dumps({name: str(file) for name, file in made.items()}))
