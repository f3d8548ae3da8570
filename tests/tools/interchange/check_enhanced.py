"""Enhanced DICOM, several frames in one file, as pydicom writes them."""
import os

import numpy as np
import pydicom
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.sequence import Sequence
from pydicom.uid import EnhancedMRImageStorage, ExplicitVRLittleEndian, RLELossless

from common import ORIGIN, SPACING, rotation, run
from volumes import expect_placed, raw_of, read_bytes, write_bytes


def item(**elements):
    one = Dataset()
    for name, value in elements.items():
        setattr(one, name, value)
    return Sequence([one])


def text(numbers):
    return [f"{n:.12g}" for n in numbers]


def groups(frame, is_frame):
    """The functional groups of one frame, or those that all share."""
    group = Dataset()
    if "position" in frame:
        group.PlanePositionSequence = item(ImagePositionPatient=text(frame["position"]))
    if "orientation" in frame:
        group.PlaneOrientationSequence = item(ImageOrientationPatient=text(frame["orientation"]))
    if "spacing" in frame:
        group.PixelMeasuresSequence = item(
            PixelSpacing=text(frame["spacing"][1::-1]),
            SliceThickness=f"{frame['spacing'][2]:.12g}")
    if "slope" in frame:
        group.PixelValueTransformationSequence = item(
            RescaleIntercept=str(frame.get("intercept", 0)), RescaleSlope=str(frame["slope"]),
            RescaleType="US")
    if is_frame:
        content = {}
        if "stack" in frame:
            content |= {"StackID": frame["stack"], "InStackPositionNumber": 1}
        if "time" in frame:
            content["TemporalPositionIndex"] = frame["time"]
        if "echo" in frame:
            content["DimensionIndexValues"] = [frame["echo"], 1]
        group.FrameContentSequence = item(**content)
    return group


def write_enhanced(path, values, frames, shared=None, syntax=None, **top):
    """An enhanced CT or MR file; `values` has a slice for each of `frames`: a dictionary with any of
    position, orientation, spacing, slope, intercept, stack, time, and echo; `shared` the same for all."""
    about = FileMetaDataset()
    about.MediaStorageSOPClassUID = EnhancedMRImageStorage
    about.MediaStorageSOPInstanceUID = "1.2.3.4"
    about.TransferSyntaxUID = ExplicitVRLittleEndian
    file = FileDataset("", {}, file_meta=about, preamble=b"\0" * 128)
    file.is_little_endian, file.is_implicit_VR = True, False
    file.SOPClassUID, file.SOPInstanceUID = EnhancedMRImageStorage, "1.2.3.4"
    file.Modality, file.StudyInstanceUID, file.SeriesInstanceUID = "MR", "1.2.3", "1.2.3.9"
    file.InstanceNumber, file.NumberOfFrames = 1, len(frames)
    file.Rows, file.Columns = values.shape[1:]
    file.SamplesPerPixel, file.PhotometricInterpretation = 1, "MONOCHROME2"
    file.BitsAllocated = file.BitsStored = 8 * values.itemsize
    file.HighBit, file.PixelRepresentation = file.BitsStored - 1, int(values.dtype.kind == "i")
    if any("echo" in frame for frame in frames):
        file.DimensionIndexSequence = Sequence([
            item(DimensionIndexPointer=0x00189082, FunctionalGroupPointer=0x00189114)[0],
            item(DimensionIndexPointer=0x00200032, FunctionalGroupPointer=0x00209113)[0]])
    if shared is not None:
        file.SharedFunctionalGroupsSequence = Sequence([groups(shared, False)])
    file.PerFrameFunctionalGroupsSequence = Sequence([groups(frame, True) for frame in frames])
    for name, value in top.items():
        setattr(file, name, value)
    file.PixelData = values.tobytes()
    if syntax == "implicit":
        about.TransferSyntaxUID = pydicom.uid.ImplicitVRLittleEndian
        file.is_implicit_VR = True
    elif syntax == "big":
        about.TransferSyntaxUID = pydicom.uid.ExplicitVRBigEndian
        file.is_little_endian = False
        file.PixelData = values.astype(values.dtype.newbyteorder(">")).tobytes()
    elif syntax is not None:
        file.compress(syntax)
    file.save_as(path, write_like_original=False)


DIRECTION, SHAPE = rotation(), (8, 11, 13)
PLANE = {"orientation": DIRECTION[:, :2].T.ravel(), "spacing": SPACING}
TWELVE_BITS = {"BitsStored": 12, "HighBit": 11}  # so that int16 holds all
VALUES = np.random.default_rng(1).integers(0, 4096, SHAPE).astype("<u2")
ORDER = np.random.default_rng(2).permutation(8)


def place(z):
    return ORIGIN + DIRECTION[:, 2] * SPACING[2] * z


def frames_at(*heights):
    return [{"position": place(z)} for z in heights]


def expect(path, expected, kind, *words):
    found, about = raw_of(path, *words)
    np.testing.assert_array_equal(found, expected)
    assert about["voxel_type"] == kind, about
    expect_placed(about, DIRECTION, tolerance=1e-8)
    return about["notes"]


def test_every_frame_has_its_own_slope():
    stored = np.full(SHAPE, 100, "<u2")
    slopes = np.arange(1, 9)
    frames = [{"position": place(z), "slope": slopes[z], "intercept": -5} for z in range(8)]
    write_enhanced("slopes.dcm", stored, frames, PLANE)
    expected = stored * slopes[:, None, None] - 5.0
    notes = expect("slopes.dcm", expected, "float32")
    assert any("differ" in note for note in notes), notes


def test_frames_are_sorted_by_position_in_every_transfer_syntax():
    frames = [{"position": place(z), "slope": int(z % 3 + 1), "intercept": -1000, **PLANE}
              for z in ORDER]
    scaled = VALUES * (np.arange(8) % 3 + 1)[:, None, None].astype("i4") - 1000
    for syntax in (None, "implicit", "big", RLELossless):
        write_enhanced("order.dcm", VALUES[ORDER], frames, syntax=syntax, **TWELVE_BITS)
        expect("order.dcm", scaled, "int16")
    os.makedirs("folder")
    write_enhanced("folder/order.dcm", VALUES[ORDER], frames, PLANE, **TWELVE_BITS)
    expect("folder", scaled, "int16")
    run("build", "order.dcm", "-o", "order.isb")


def test_signed_frames_and_frames_of_8_and_32_bits_are_read():
    for kind, name in (("<i2", "int16"), ("u1", "uint8"), ("i1", "int8"), ("<u4", "float32")):
        plain = np.random.default_rng(3).integers(0, 100, SHAPE).astype(kind)
        if kind.startswith("<i") or kind == "i1":
            plain -= 50
        write_enhanced("kind.dcm", plain[ORDER], frames_at(*ORDER), PLANE)
        expect("kind.dcm", plain, name)


def test_gaps_and_two_frames_at_one_place_are_refused():
    write_enhanced("gap.dcm", VALUES[:6], frames_at(0, 1, 2, 5, 6, 7), PLANE)
    run("build", "gap.dcm", fails_with="mm apart")
    write_enhanced("double.dcm", VALUES[:4], frames_at(0, 1, 1, 2), PLANE)
    run("build", "double.dcm", fails_with="same position")


def test_one_of_two_time_points_stacks_or_echoes_is_chosen():
    for what, key, name in (("time", "time", lambda n: str(n)),
                               ("stack", "grid", lambda n: "AB"[n]),
                               ("echo", "channel", lambda n: str(n))):
        number = (lambda n: "AB"[n]) if what == "stack" else (lambda n: n + 1)
        frames = [{"position": place(z), what: number(n)} for z in range(4) for n in range(2)]
        write_enhanced(f"{what}.dcm", VALUES, frames, PLANE, **TWELVE_BITS)
        run("build", f"{what}.dcm", fails_with=f"--select {key}=")
        for n in range(2):
            notes = expect(f"{what}.dcm", VALUES[n::2], "int16", "--select", f"{key}={name(n)}")
        run("build", f"{what}.dcm", "--select", key + ("=C" if what == "stack" else "=2"),
            fails_with=f"--select {key}=")
        run("build", f"{what}.dcm", "--select", f"{key}={name(0)}", "-o", "choice.isb")
        assert "up to date" in run("build", f"{what}.dcm", "--select", f"{key}={name(0)}", "-o", "choice.isb").stdout
        again = run("build", f"{what}.dcm", "--select", f"{key}={name(1)}", "-o", "choice.isb")
        assert "up to date" not in again.stdout, again.stdout
        os.remove("choice.isb")


def test_the_distance_of_frames_without_positions_is_an_assumption_until_it_is_given():
    write_enhanced("unplaced.dcm", VALUES, [{} for _ in range(8)], PLANE, **TWELVE_BITS)
    found, about = raw_of("unplaced.dcm")
    np.testing.assert_array_equal(found, VALUES)
    assert any("assumption" in note and "2.5" in note for note in about["notes"]), about["notes"]
    notes = raw_of("unplaced.dcm", "--spacing", "0.7,0.5,3")[1]["notes"]
    assert not any("assumption" in note for note in notes), notes


def test_files_that_are_cut_are_refused():
    small = np.arange(2 * 2 * 3, dtype="<u2").reshape(3, 2, 2)
    write_enhanced("small.dcm", small, frames_at(0, 1, 2), PLANE)
    whole = read_bytes("small.dcm")
    for size in range(132, len(whole), 97):
        write_bytes("cut.dcm", whole[:size])
        run("build", "cut.dcm", fails_with="cut.dcm")
