#!/usr/bin/env python3
"""Compares two builds of isobrick: pyramids of ten volumes and the meshes of 200 queries, byte by byte.

    tests/tools/same_results.py OLD_BIN_FOLDER NEW_BIN_FOLDER [DATA_FOLDER]

Phantoms take the place of real volumes that are not there. The provenance of a pyramid names the
program's version; everything else of the two files has to be the same. Ends with 1 if anything
differs."""
import hashlib
import json
import pathlib
import random
import re
import subprocess
import sys
import tempfile

PHANTOMS = [("head", 160, "u16"), ("gyroid", 129, "f32"), ("sphere", 100, "u8"), ("marschner-lobb", 97, "i16")]
REAL = ["headsq_quarter/headsq_quarter.mhd", "vhf_head_ct/vhf_head.nrrd", "vhf_head_ct/dicom",
        "tooth_u16be/tooth.nhdr", "engine/engine.vti", "mr_nifti/MR.nii.gz", "aneurism/aneurism.vti",
        "fingers_f32/fingers.vti", "vdb/smoke.vdb", "vdb/sphere.vdb"]


def run(binary, *arguments):
    done = subprocess.run([binary, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{binary} {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def volumes(old, data, folder):
    """Paths of ten volumes."""
    found = [path for name in sorted(REAL) if (path := data / name).exists()] if data else []
    kinds = PHANTOMS + [("torus", 64 + 8 * n, "u16") for n in range(6)]
    for kind, size, voxel_type in kinds:
        if len(found) >= 10:
            break
        path = folder / f"{kind}{size}.nrrd"
        run(old / "isobrick", "phantom", kind, "--voxels", size, "--type", voxel_type, "-o", path)
        found.append(path)
    return found[:10]


def hash_without_version(path):
    """The hash of all bytes but the program's version in the provenance and the checksums over it."""
    data = bytearray(re.sub(rb"isobrick \d\.\d\.\d", b"isobrick -.-.-", path.read_bytes()))
    data[264:272] = data[504:512] = bytes(8)
    return hashlib.sha256(data).hexdigest()


def queries(info, random_numbers):
    """Twenty queries: uniform, focus, curvature, view and box."""
    x, y, z = info["dimensions"]
    low, high = info["value_range"]
    for n in range(20):
        isovalue = low + (high - low) * random_numbers.uniform(0.1, 0.9)
        centre = ",".join(str(random_numbers.uniform(0, d)) for d in (x, y, z))
        focus = ["--focus", centre, "--radius", random_numbers.uniform(2, 60)]
        box = [random_numbers.uniform(0, d / 2) for d in (x, y, z)] + [
            random_numbers.uniform(d / 2, d) for d in (x, y, z)]
        choices = [
            ["--level", random_numbers.randrange(len(info["levels"]))], focus,
            ["--curvature-radius", random_numbers.uniform(1, 20)],
            focus + ["--curvature", random_numbers.uniform(0, 1)],
            ["--box", ",".join(map(str, box))] + focus]
        yield ["--iso", isovalue, *choices[n % len(choices)]]


def main():
    old, new = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    data = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
    random_numbers = random.Random(24)
    differing = pyramids = meshes = 0
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for volume in volumes(old, data, folder):
            files = {}
            for tag, binary in (("old", old), ("new", new)):
                files[tag] = folder / f"{tag}.isb"
                run(binary / "isobrick", "build", volume, "-o", files[tag], "--force")
            pyramids += 1
            if hash_without_version(files["old"]) != hash_without_version(files["new"]):
                differing += 1
                print(f"{volume}: the pyramids differ")
            info = json.loads(run(old / "isobrick", "info", files["old"], "--json"))
            for query in queries(info, random_numbers):
                hashes = set()
                for tag, binary in (("old", old), ("new", new)):
                    mesh = folder / f"{tag}.ply"
                    run(binary / "isobrick", "extract", files["old"], *query, "-o", mesh, "--force")
                    hashes.add(hashlib.sha256(mesh.read_bytes()).hexdigest())
                meshes += 1
                if len(hashes) > 1:
                    differing += 1
                    print(f"{volume}: {' '.join(map(str, query))}: the meshes differ")
    print(f"{pyramids} pyramids and {meshes} meshes compared: {differing} differ")
    return differing > 0


if __name__ == "__main__":
    sys.exit(main())
