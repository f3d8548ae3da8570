#!/usr/bin/env python3
"""The league: the same volumes through isobrick and the programs that people use now, one page, losses included.

    tools/league.py ISOBRICK CASES DATA [-o docs/league.md]      and the table of README.md

CASES: the folder of ../shared/cases/surfaces; DATA: of ../shared/data. Every mesh is made by a process of its own, which
reads the volume and writes the mesh. The script installs scikit-image, VTK, PyMCubes, MeshLib and SimpleITK from PyPI
into an environment of its own beneath build/; OpenVDB is Debian's python3-openvdb, by Debian's Python."""
import argparse
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / "build/league"
PACKAGES = ["numpy", "scikit-image", "vtk", "PyMCubes", "meshlib", "SimpleITK"]
# Lines of the table, and the Python that has the package.
ENGINES = {"isobrick": None, "isobrick --simplify 0.1": None, "vtkFlyingEdges3D": VENV, "scikit-image": VENV,
           "OpenVDB": "/usr/bin/python3", "PyMCubes": VENV, "MeshLib": VENV}
# Isovalue, then the volume that is right, in cubes of the least spacing, if it is known.
CASES = {
    "aniso.nrrd": (0, 0), "border_face.nrrd": (0, 0), "border_slab.nrrd": (0, 0),
    "cell_11100101.nrrd": (0, 0), "cell_11100110.nrrd": (0, 0), "epoch32i.nrrd": (1700000000, 1629.5),
    "hollow.nrrd": (0, 0), "ids32.nrrd": (16777216.5, 0), "level_set.vdb": (0, 0),
    "masked.nrrd": (10, 1047.4), "plane.nrrd": (0, 0), "plate2.0.nrrd": (0, 0), "pore.nrrd": (20000, 0),
    "pressure64.nrrd": (101325, 1629.5), "sentinel32.nrrd": (0, 0), "shell1.2.nrrd": (0, 0),
    "tsdf.nii.gz": (0, 1047.4), "utm_10cm.nrrd": (0, 1629.5), "zero_area.nrrd": (0, 0)}
SCANS = {"vhf_head_ct/vhf_head.nrrd": 1250, "tooth_u16be/tooth.nhdr": 520, "mr_nifti/MR.nii.gz": 40}


# ---- volumes

NRRD_TYPES = {"unsigned char": "u1", "signed char": "i1", "unsigned short": "u2", "short": "i2", "unsigned int": "u4",
              "int": "i4", "float": "f4", "double": "f8"}  # as SimpleITK writes them


def read_volume(path):
    """Values as [z, y, x], spacing and origin along x, y, z, of a NRRD without compression, which read_any() wrote."""
    import numpy
    with open(path, "rb") as file:
        header = file.read(65536).split(b"\n\n", 1)[0].decode("latin-1")
        file.seek(len(header) + 2)
        fields = dict(line.split(": ", 1) for line in header.splitlines() if ": " in line)
        sizes = [int(word) for word in fields["sizes"].split()]
        values = numpy.fromfile(file, "<" + NRRD_TYPES[fields["type"]], sizes[0] * sizes[1] * sizes[2])
    rows = re.findall(r"\(([^)]*)\)", fields["space directions"])
    spacing = [float(numpy.linalg.norm([float(x) for x in row.split(",")])) for row in rows]
    origin = [float(x) for x in re.findall(r"\(([^)]*)\)", fields["space origin"])[0].split(",")]
    return values.reshape(sizes[::-1]), spacing, origin


def prepare(path, target):
    """Writes the volume as NRRD without compression, along the axes of the world, which all of them read."""
    import SimpleITK
    image = SimpleITK.ReadImage(path)
    image.SetDirection([1, 0, 0, 0, 1, 0, 0, 0, 1])
    SimpleITK.WriteImage(image, target, False)


# ---- engines: each ends with points, triangles and the seconds that the surface alone took

def run_vtk(volume, iso, spacing, origin, out):
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D
    from vtkmodules.vtkIOPLY import vtkPLYWriter
    image = vtkImageData()
    image.SetDimensions(*volume.shape[::-1])
    image.SetSpacing(spacing)
    image.SetOrigin(origin)
    image.GetPointData().SetScalars(numpy_to_vtk(volume.ravel()))
    filter_ = vtkFlyingEdges3D()
    filter_.SetInputData(image)
    filter_.SetValue(0, iso)
    begin = time.perf_counter()
    filter_.Update()
    seconds = time.perf_counter() - begin
    writer = vtkPLYWriter()
    writer.SetInputConnection(filter_.GetOutputPort())
    writer.SetFileName(out)
    writer.Write()
    return None, None, seconds


def run_skimage(volume, iso, spacing, origin, _):
    from skimage.measure import marching_cubes
    begin = time.perf_counter()
    points, faces, *_ = marching_cubes(volume, iso, spacing=spacing[::-1])
    return points[:, ::-1] + origin, faces, time.perf_counter() - begin


def run_pymcubes(volume, iso, spacing, origin, _):
    import mcubes
    begin = time.perf_counter()
    points, faces = mcubes.marching_cubes(volume, iso)
    return points[:, ::-1] * spacing + origin, faces[:, ::-1], time.perf_counter() - begin


def run_meshlib(volume, iso, spacing, origin, _):
    import numpy
    from meshlib import mrmeshnumpy, mrmeshpy
    begin = time.perf_counter()
    simple = mrmeshnumpy.simpleVolumeFrom3Darray(numpy.ascontiguousarray(volume.T, dtype=numpy.float32))
    simple.voxelSize = mrmeshpy.Vector3f(*spacing)
    parameters = mrmeshpy.MarchingCubesParams()
    parameters.iso = iso
    mesh = mrmeshpy.marchingCubes(simple, parameters)
    seconds = time.perf_counter() - begin
    # Samples are in the middle of its voxels.
    points = mrmeshnumpy.getNumpyVerts(mesh) - 0.5 * numpy.array(spacing) + origin
    return points, mrmeshnumpy.getNumpyFaces(mesh.topology), seconds


def run_openvdb(volume, iso, spacing, origin, path):
    import numpy
    import pyopenvdb
    if volume is None:
        grid = pyopenvdb.read(path, pyopenvdb.readAllGridMetadata(path)[0].name)
    else:
        grid = pyopenvdb.FloatGrid(float(volume.min()))
        grid.copyFromArray(numpy.ascontiguousarray(volume.T, dtype=numpy.float32))
        grid.transform = pyopenvdb.createLinearTransform([[spacing[0], 0, 0, 0], [0, spacing[1], 0, 0],
                                                          [0, 0, spacing[2], 0], [*origin, 1]])
    begin = time.perf_counter()
    points, triangles, quads = grid.convertToPolygons(isovalue=iso, adaptivity=0.0)
    seconds = time.perf_counter() - begin
    faces = numpy.concatenate([triangles.reshape(-1, 3), quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return points, faces, seconds


RUNS = {"vtkFlyingEdges3D": run_vtk, "scikit-image": run_skimage, "PyMCubes": run_pymcubes, "MeshLib": run_meshlib,
        "OpenVDB": run_openvdb}


def run_engine(name, path, iso, out):
    """In a process of its own: the mesh to `out`."""
    import numpy
    if path.endswith(".vdb"):
        if name != "OpenVDB":
            sys.exit("does not read OpenVDB")
        points, faces, seconds = run_openvdb(None, iso, None, None, path)
    else:
        volume, spacing, origin = read_volume(path)
        points, faces, seconds = RUNS[name](volume, iso, spacing, origin, out)
    if points is not None:
        numpy.savez(out + ".npz", points=points, faces=faces)
    print(json.dumps(seconds))


# ---- meshes

def read_ply(path):
    """Points and triangles of a binary file of isobrick or VTK."""
    import numpy
    data = path.read_bytes()
    header, body = data.split(b"end_header\n", 1)
    sizes = {"float": "f4", "double": "f8", "uchar": "u1"}
    counts, fields, element = {}, {"vertex": [], "face": []}, ""
    for line in header.decode().splitlines():
        words = line.split()
        if words[:1] == ["element"]:
            element = words[1]
            counts[element] = int(words[2])
        elif words[:2] == ["property", "list"]:
            fields[element] += [("count", "u1"), ("corners", "<i4", 3)]
        elif words[:1] == ["property"]:
            fields[element].append((words[2], "<" + sizes[words[1]]))
    vertices = numpy.frombuffer(body, numpy.dtype(fields["vertex"]), counts["vertex"])
    faces = numpy.frombuffer(body, numpy.dtype(fields["face"]), counts["face"], vertices.nbytes)["corners"]
    return numpy.stack([vertices[axis] for axis in "xyz"], 1).astype(float), faces


def judge(source, mesh):
    """What is wrong with a mesh: numbers of triangles and sides, and the volume of a closed one."""
    import numpy
    from meshlib import mrmeshnumpy, mrmeshpy
    values, spacing, origin = read_volume(source) if source.endswith(".nrrd") else (numpy.empty((2,) * 3), [1] * 3, [0] * 3)
    if mesh.endswith(".npz"):
        with numpy.load(mesh) as file:
            points, faces = file["points"], file["faces"]
    else:
        points, faces = read_ply(pathlib.Path(mesh))
    said = {"triangles": len(faces)}
    if len(faces) == 0:
        return said
    # Programs that repeat vertices on borders of blocks have one of them here.
    points, first = numpy.unique((numpy.asarray(points, float) - origin) / min(spacing), axis=0, return_inverse=True)
    faces = first.reshape(-1)[numpy.asarray(faces, numpy.int64)]
    flat = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    faces = faces[~flat]
    directed = numpy.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    key = directed[:, 0] * len(points) + directed[:, 1]
    back = directed[:, 1] * len(points) + directed[:, 0]
    open_edges = directed[~numpy.isin(key, back)]
    end = numpy.array(spacing) / min(spacing) * (numpy.array(values.shape[::-1]) - 1)
    inside = numpy.ones(len(open_edges), bool)
    for axis in range(3):
        for side in (0.0, end[axis]):
            inside &= (abs(points[open_edges, axis] - side) > 1e-3).any(1)
    mesh = mrmeshnumpy.meshFromFacesVerts(faces.astype(numpy.int32), points.astype(numpy.float32))
    crossed = len(mrmeshpy.findSelfCollidingTriangles(mrmeshpy.MeshPart(mesh)))
    a, b, c = (points[faces[:, i]] for i in range(3))
    said |= {"flat": int(flat.sum()), "open": int(inside.sum()), "crossed": crossed,
             "oriented": len(numpy.unique(key)) == len(key)}
    if len(open_edges) == 0:
        said["volume"] = float((a * numpy.cross(b, c)).sum() / 6)
    return said


def measure(command):
    """Exit status, what it printed, seconds and MiB at the peak of a process."""
    begin = time.perf_counter()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(["timeout", "300", *command], stdout=out, stderr=errors)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - begin
        texts = []
        for file in (out, errors):
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
    return os.waitstatus_to_exitcode(status), *texts, seconds, usage.ru_maxrss / 1024


def ask(*words):
    """What this script prints in a process of its own: this one stays small, since a new process counts its memory."""
    return subprocess.run([sys.executable, __file__, *map(str, words)], check=True, capture_output=True, text=True).stdout


def run_row(engine, python, isobrick, path, source, iso, folder):
    out = folder / "mesh.ply"
    for old in folder.glob("mesh.ply*"):
        old.unlink()
    if python is None:
        own = path if path.name.startswith("tsdf") else source  # SimpleITK reads infinite values as others
        command = [isobrick, "extract", str(own), f"--iso={iso}", "-o", str(out), "--json", *engine.split()[1:]]
        if source.name.startswith("masked"):
            command.append("--mask-nan")
    else:
        binary = python if isinstance(python, str) else str(python / "bin/python")
        command = [binary, __file__, "--engine", engine, str(source), repr(iso), str(out)]
    status, said, complaint, seconds, mebibytes = measure(command)
    if status != 0:
        return {"refused": (complaint.splitlines() or [f"ended with {status}"])[-1].replace(f"{path.parent}/", "")}
    inner = json.loads(said)["seconds"]["extract"][0] if python is None else float(said.splitlines()[-1])
    row = json.loads(ask("--judge", source, out if out.exists() else str(out) + ".npz"))
    return row | {"seconds": seconds, "MiB": mebibytes, "rate": row["triangles"] / 1e6 / inner}


def run_volume(path, iso, isobrick, folder):
    source = path
    if path.suffix != ".vdb":
        source = folder / (path.name.split(".")[0] + ".prepared.nrrd")
        ask("--prepare", path, source)
    rows = {}
    for engine, python in ENGINES.items():
        rows[engine] = run_row(engine, python, isobrick, path, source, iso, folder)
        print(path.name, engine, json.dumps(rows[engine]), sep="\t", flush=True)
    return rows


# ---- the page

def verdict(row, right):
    """A cell of the first table."""
    if "refused" in row:
        return "refused"
    if row["triangles"] == 0:
        return "nothing"
    wrong = [f"{row['open']} open sides"] * (row["open"] > 0) + [f"{row['crossed']} crossings"] * (row["crossed"] > 0)
    wrong += ["not oriented"] * (not row["oriented"]) + [f"{row['flat']} flat"] * (row["flat"] > 0)
    if right > 0 and abs(abs(row.get("volume", 0)) - right) > 0.02 * right:
        wrong.append(f"volume {100 * (abs(row.get('volume', 0)) / right - 1):+.0f} %")
    return ", ".join(wrong) or "good"


def table(head, lines):
    made = ["| " + " | ".join(line) + " |" for line in [head, *lines]]
    return [made[0], "|---" * len(head) + "|", *made[1:], ""]


def page(results):
    """`results`: by the volume's path, isovalue, right volume and rows by program."""
    names = list(ENGINES)
    verdicts = {path.name: [verdict(rows[name], right) for name in names] for path, (_, right, rows) in results.items()}
    good = [name for name, cells in verdicts.items() if set(cells) == {"good"}]
    lines = [PAGE, *table(["volume", *names], [[name, *cells] for name, cells in verdicts.items() if name not in good]),
             f"All are good at {', '.join(good[:-1])} and {good[-1]}.\n"]
    refused = {(path.name, row["refused"]) for path, (_, _, rows) in results.items()
               for name, row in rows.items() if name == "isobrick" and "refused" in row}
    lines += [f"isobrick refuses {name}: {text.removeprefix('isobrick: ')}.\n" for name, text in sorted(refused)]
    groups = {path.name: [rows] for path, (_, _, rows) in list(results.items())[-len(SCANS):]}
    groups["small ones, median"] = [rows for _, (_, _, rows) in list(results.items())[:-len(SCANS)]]
    head = ["", *(words for name in groups for words in (f"{name}: s", "MiB", "Mtri/s"))][:-1]
    numbers = []
    for program in names:
        cells = [program]
        for group in groups.values():
            done = [rows[program] for rows in group if "seconds" in rows[program]]
            cells += [f"{statistics.median(row[key] for row in done):{shape}}" if done else ""
                      for key, shape in (("seconds", ".2f"), ("MiB", ".0f"), ("rate", ".2f"))]
        numbers.append(cells[:-1])
    return lines + table(head, numbers)


def front(page):
    """The README's table: what the page says of the head CT, the first of the scans."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line.startswith("| ")]
    said = next((row[1:] for row in rows if row[0] == "vhf_head.nrrd"), ["good"] * len(ENGINES))
    seconds = {row[0]: (float(row[1]), row[2]) for row in rows if row[0] in ENGINES}
    own = seconds["isobrick"][0]
    return "\n".join(table(["", "seconds", "× isobrick", "peak MiB", "mesh"], [
        [program, f"{seconds[program][0]:.2f}", f"{seconds[program][0] / own:.1f}", seconds[program][1], verdict]
        for program, verdict in zip(ENGINES, said) if program in seconds and program != "isobrick --simplify 0.1"]))


def with_front(readme, page):
    return re.sub(r"(<!-- league -->\n).*?(?=<!-- end -->)", lambda match: match[1] + front(page), readme, flags=re.S)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("isobrick", "cases", "data"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, default=ROOT / "docs/league.md")
    arguments = parser.parse_args()
    volumes = [(arguments.cases / name, *wanted) for name, wanted in CASES.items()]
    volumes += [(arguments.data / name, iso, 0) for name, iso in SCANS.items()]
    loads, results = [], {}
    with tempfile.TemporaryDirectory() as folder:
        for path, iso, right in volumes:
            loads.append(os.getloadavg()[0])
            results[path] = iso, right, run_volume(path, iso, arguments.isobrick, pathlib.Path(folder))
    machine = f"*Machine*: {os.cpu_count()} cores; its load was {min(loads):.1f} to {max(loads):.1f} (1 is this script's)."
    arguments.output.write_text("\n".join([*page(results), machine]) + "\n")
    readme = ROOT / "README.md"
    readme.write_text(with_front(readme.read_text(), arguments.output.read_text()))


PAGE = """<!-- tools/league.py made this page. -->
# The league

This page shows you the same volumes through isobrick and the programs that people use now: what is wrong with their meshes,
and what they take.

- *good*: open at the border of the volume or nowhere, every side once each way round, no triangle without area (*flat*), no two
  that cross (MeshLib's test, in single precision), and the volume within 2 % of what is known of it.
- All read the same NRRD without compression. OpenVDB's own file is read by isobrick and OpenVDB alone. For OpenVDB the inside
  is below the isovalue, and it closes surfaces at the border.
- Small volumes have one property each that people reported as a fault of some program; the last three are scans.
- *seconds* and *MiB* at the peak are of the whole process, from volume to mesh file, *Mtri/s* of the surface alone; isobrick reads
  while it extracts.
"""

if __name__ == "__main__":
    if sys.argv[1:2] == ["--engine"]:
        sys.exit(run_engine(sys.argv[2], sys.argv[3], float(sys.argv[4]), sys.argv[5]))
    if sys.argv[1:2] == ["--judge"]:
        sys.exit(print(json.dumps(judge(sys.argv[2], sys.argv[3]))))
    if sys.argv[1:2] == ["--prepare"]:
        sys.exit(prepare(sys.argv[2], sys.argv[3]))
    if pathlib.Path(sys.prefix) != VENV:
        if not (VENV / "bin/python").exists():
            subprocess.run(["/usr/bin/python3", "-m", "venv", VENV], check=True)
            subprocess.run([VENV / "bin/pip", "install", "-q", *PACKAGES], check=True)
        os.execv(VENV / "bin/python", [str(VENV / "bin/python"), *sys.argv])
    main()
