// TIFF pictures of all forms have the numbers that were written.
#include "isobrick/preprocess/sources/tiff_source.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/storage/index_loop.h"
#include "tests/extract/random_case.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/tiff_file.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {
namespace {

struct NumberKind {
  std::uint32_t kind, bytes;
  VoxelType delivered;
};
constexpr NumberKind kKinds[] = {
    {1, 1, VoxelType::kUint8},   {2, 1, VoxelType::kInt8},    {1, 2, VoxelType::kUint16},
    {2, 2, VoxelType::kInt16},   {3, 2, VoxelType::kFloat32}, {1, 4, VoxelType::kFloat32},
    {2, 4, VoxelType::kFloat32}, {3, 4, VoxelType::kFloat32}, {1, 8, VoxelType::kFloat32},
    {2, 8, VoxelType::kFloat32}, {3, 8, VoxelType::kFloat32}};

template <typename T>
std::string bytesOf(T value) {
  return {reinterpret_cast<const char*>(&value), sizeof(value)};
}
template <typename T>
T numberIn(const std::string& bytes) {
  T value;
  std::memcpy(&value, bytes.data(), sizeof(value));
  return value;
}

// The number that the bytes of one of a kind stand for.
float floatOf(const NumberKind& number, const std::string& bytes) {
  switch (10 * number.kind + number.bytes) {
    case 14:
      return static_cast<float>(numberIn<std::uint32_t>(bytes));
    case 24:
      return static_cast<float>(numberIn<std::int32_t>(bytes));
    case 34:
      return numberIn<float>(bytes);
    case 18:
      return static_cast<float>(numberIn<std::uint64_t>(bytes));
    case 28:
      return static_cast<float>(numberIn<std::int64_t>(bytes));
    case 38:
      return static_cast<float>(numberIn<double>(bytes));
    default: {  // a half, by its definition
      const auto half = numberIn<std::uint16_t>(bytes);
      const int exponent = half >> 10 & 31;
      const double fraction = (half & 1023) / 1024.0;
      const double size =
          exponent == 0 ? std::ldexp(fraction, -14) : std::ldexp(1 + fraction, exponent - 15);
      return static_cast<float>(half >> 15 != 0 ? -size : size);
    }
  }
}

// Numbers of any value; floating ones are finite.
std::string randomNumbers(RandomCase& random, const NumberKind& number, std::int64_t count) {
  std::string bytes;
  for (std::int64_t i = 0; i < count; ++i) {
    const double value = random.uniform(-1000000, 1000000) / 256.0;
    if (number.kind == 3 && number.bytes == 2)
      bytes += bytesOf(
          static_cast<std::uint16_t>(random.uniform(0, 1) << 15 | random.uniform(0, 0x7bff)));
    else if (number.kind == 3)
      bytes += number.bytes == 4 ? bytesOf(static_cast<float>(value)) : bytesOf(value);
    else
      for (std::uint32_t byte = 0; byte < number.bytes; ++byte)
        bytes += static_cast<char>(random.uniform(0, 255));
  }
  return bytes;
}

// The voxels of the pictures as they are delivered.
std::string expectedVoxels(const NumberKind& number, const std::vector<TiffPixels>& pages,
                           std::uint32_t component) {
  std::string voxels;
  for (const TiffPixels& page : pages)
    for (std::size_t pixel = 0; pixel < std::size_t{page.width} * page.height; ++pixel) {
      const std::string bytes =
          page.numbers.substr((pixel * page.samples + component) * page.bytes, page.bytes);
      voxels += number.delivered == VoxelType::kFloat32 ? bytesOf(floatOf(number, bytes)) : bytes;
    }
  return voxels;
}

std::string allVoxels(VolumeSource& source) {
  const Index3& voxels = source.info().voxels;
  std::string bytes(
      static_cast<std::size_t>(elementCount(voxels)) * voxelBytes(source.info().voxel_type), '\0');
  source.readRows(0, voxels.y * voxels.z, bytes.data());
  return bytes;
}

void expectBoxes(RandomCase& random, const VolumeSource& source, const std::string& all) {
  const Index3& voxels = source.info().voxels;
  const std::size_t size = voxelBytes(source.info().voxel_type);
  for (int i = 0; i < 10; ++i) {
    IndexBox box;
    for (int axis = 0; axis < 3; ++axis) {
      const auto most = static_cast<int>(voxels[axis]);
      box.first[axis] = random.uniform(0, most - 1);
      box.count[axis] = random.uniform(1, most - static_cast<int>(box.first[axis]));
    }
    if (random.chance(0.3)) box.first.x = 0, box.count.x = voxels.x;
    std::string read(static_cast<std::size_t>(box.size()) * size, '\0'), expected;
    source.readBox(box, read.data());
    forEachIndex({box.first, {1, box.count.y, box.count.z}}, [&](const Index3& row) {
      expected += all.substr(static_cast<std::size_t>(linearIndex(row, voxels)) * size,
                             static_cast<std::size_t>(box.count.x) * size);
    });
    ASSERT_TRUE(read == expected);
  }
}

void expectNumbersOfARandomVolume(std::uint32_t seed) {
  RandomCase random(seed);
  const TemporaryFolder folder;
  const NumberKind number = kKinds[seed % std::size(kKinds)];
  TiffForm form;
  form.is_big_tiff = random.chance(0.3);
  form.is_packed = random.chance(0.5);
  form.rows_per_strip = static_cast<std::uint32_t>(random.uniform(1, 45));
  form.tile = random.chance(0.4) ? 16 : 0;
  const bool is_one_file = random.chance(0.6);
  TiffPixels pixels;
  pixels.width = static_cast<std::uint32_t>(random.uniform(2, 40));
  pixels.height = static_cast<std::uint32_t>(random.uniform(2, 40));
  pixels.bytes = number.bytes;
  pixels.kind = number.kind;
  pixels.samples =
      is_one_file && random.chance(0.5) ? static_cast<std::uint32_t>(random.uniform(2, 4)) : 1;
  form.is_separate = pixels.samples > 1 && random.chance(0.5);
  std::vector<TiffPixels> pages;
  for (int z = random.uniform(2, 9); z > 0; --z) {
    pixels.numbers =
        randomNumbers(random, number, std::int64_t{pixels.width} * pixels.height * pixels.samples);
    pages.push_back(pixels);
  }
  const std::string path = folder.file(is_one_file ? "scan.tif" : "slices");
  form.big_endian = random.chance(0.5);
  if (is_one_file) {
    TiffBuilder tiff(form);
    for (const TiffPixels& page : pages) tiff.addPage(page);
    writeBytes(path, tiff.bytes());
  } else {
    std::filesystem::create_directory(path);
    for (std::size_t z = 0; z < pages.size(); ++z) {
      form.big_endian = random.chance(0.5);
      TiffBuilder tiff(form);
      tiff.addPage(pages[z]);
      writeBytes(path + "/" + std::to_string(z) + ".tif", tiff.bytes());
    }
  }
  OpenOptions options;
  std::uint32_t component = 0;
  if (pixels.samples > 1) {
    component = static_cast<std::uint32_t>(random.uniform(0, static_cast<int>(pixels.samples) - 1));
    options.component = ComponentChoice{false, component};
  }
  const auto source = openItkSource(path, options);
  EXPECT_EQ(source->info().voxels, Index3(pixels.width, pixels.height, std::ssize(pages)));
  EXPECT_EQ(source->info().voxel_type, number.delivered);
  EXPECT_EQ(source->files().size(), is_one_file ? 1 : pages.size());
  const bool is_half = number.kind == 3 && number.bytes == 2;
  EXPECT_EQ(source->readsBoxes(),
            !form.is_packed && form.tile == 0 && !form.is_separate && !is_half);
  const std::string all = allVoxels(*source);
  ASSERT_TRUE(all == expectedVoxels(number, pages, component));
  if (source->readsBoxes()) expectBoxes(random, *source, all);
}

TEST(TiffSourceTest, HasTheNumbersOfAnyForm) {
  for (std::uint32_t seed = 0; seed < 330; ++seed) {
    SCOPED_TRACE(seed);
    ASSERT_NO_FATAL_FAILURE(expectNumbersOfARandomVolume(seed));
  }
}

// One packed picture among plain ones is unpacked; one of another type makes it no volume.
TEST(TiffSourceTest, SlicesOfAStackMayDifferInHowTheyAreStored) {
  const TemporaryFolder folder;
  const auto slice = [&](int z, const TiffForm& form, std::uint32_t kind = 1) {
    TiffBuilder tiff(form);
    tiff.addPage({6, 5, 2, kind, 1, std::string(60, static_cast<char>(z))});
    writeBytes(folder.file(std::to_string(z) + ".tif"), tiff.bytes());
  };
  for (int z = 0; z < 4; ++z) slice(z, {});
  const auto plain = openItkSource(folder.path());
  EXPECT_TRUE(plain->readsBoxes());
  const std::string all = allVoxels(*plain);
  TiffForm packed;
  packed.is_packed = true;
  slice(2, packed);
  const auto source = openItkSource(folder.path());
  EXPECT_FALSE(source->readsBoxes());
  EXPECT_TRUE(allVoxels(*source) == all);
  slice(2, {}, 2);
  const auto other = openItkSource(folder.path());
  EXPECT_FALSE(other->readsBoxes());
}

// ITK, which reads pictures of other forms, leaves 32-bit integers at zero and halves as integers.
TEST(TiffSourceTest, FormsThatItkMisreadsAreRefused) {
  const TemporaryFolder folder;
  for (const NumberKind& number : kKinds) {
    const bool is_misread = number.bytes > 2 ? number.kind != 3 || number.bytes == 8
                                             : number.bytes == 2 && number.kind == 3;
    if (!is_misread) continue;
    SCOPED_TRACE(testing::Message() << "kind " << number.kind << " of " << number.bytes);
    TiffBuilder tiff({});
    for (int z = 0; z < 3; ++z)
      tiff.addPage({4, 4, number.bytes, number.kind, 1, std::string(16 * number.bytes, '\1')});
    std::string bytes = tiff.bytes();
    // Another corner comes first: tag 284, whose value means nothing for one number, becomes 274.
    for (std::size_t at = 0; (at = bytes.find("\x1c\x01\x04", at)) != std::string::npos;) {
      bytes[at] = '\x12';
      bytes[at + 8] = '\4';
    }
    writeBytes(folder.file("scan.tif"), bytes);
    const std::string message = errorOf([&] { openItkSource(folder.file("scan.tif")); });
    EXPECT_CONTAINS(message, "scan.tif");
  }
}

// The search for slices went round such a circle for ever, as previews are no slices.
TEST(TiffSourceTest, PagesInACircleAreRefused) {
  const TemporaryFolder folder;
  for (const bool is_preview : {false, true}) {
    TiffForm form;
    form.is_preview = is_preview;
    TiffBuilder tiff(form);
    tiff.addPage({4, 4, 1, 1, 1, std::string(16, 'x')});
    std::string bytes = tiff.bytes();
    bytes.replace(bytes.size() - 4, 4, bytes, 4, 4);  // behind the page comes the page
    writeBytes(folder.file("scan.tif"), bytes);
    EXPECT_CONTAINS(errorOf([&] { openItkSource(folder.file("scan.tif")); }), "scan.tif");
  }
}

TEST(TiffSourceTest, AFileThatBecomesShorterIsNamed) {
  const TemporaryFolder folder;
  TiffBuilder tiff({});
  for (int z = 0; z < 3; ++z) tiff.addPage({50, 40, 1, 1, 1, std::string(2000, 'x')});
  writeBytes(folder.file("scan.tif"), tiff.bytes());
  const auto source = openItkSource(folder.file("scan.tif"));
  ASSERT_TRUE(source->readsBoxes());
  std::filesystem::resize_file(folder.file("scan.tif"), 3000);
  EXPECT_CONTAINS(errorOf([&] { allVoxels(*source); }), "scan.tif' at byte 3000: the file became");
}

// Tags that lie lead to another reader, to one error, or to voxels of the file. (ITK, which would
// look next, takes seconds for some of these files.)
TEST(TiffSourceTest, ChangedBytesAreNotBelieved) {
  const TemporaryFolder folder;
  RandomCase random(7);
  int whole = 0, damaged = 0, others = 0;
  for (int i = 0; i < 4000; ++i) {
    TiffForm form;
    form.rows_per_strip = 4;
    form.is_packed = random.chance(0.5);
    form.tile = random.chance(0.3) ? 16 : 0;
    TiffBuilder tiff(form);
    for (int z = 0; z < 3; ++z)
      tiff.addPage({9, 8, 1, 1, 1, std::string(72, static_cast<char>('a' + z))});
    std::string bytes = tiff.bytes();
    const auto at = static_cast<std::size_t>(random.uniform(0, static_cast<int>(bytes.size()) - 1));
    bytes[at] = static_cast<char>(random.uniform(0, 255));
    if (random.chance(0.1)) bytes.resize(at);
    const std::string path = folder.file("scan.tif");
    writeBytes(path, bytes);
    try {
      const auto slices = findTiffSlices({path}, {});
      ++(slices ? whole : others);
      if (!slices || slices->form.width * slices->form.height > 1000000) continue;
      VolumeInfo info;
      info.source = path;
      info.voxels = Index3(slices->form.width, slices->form.height, std::ssize(slices->slices));
      StoredVoxels stored;
      stored.type = slices->form.type;
      stored.components = slices->form.samples;
      info.voxel_type = stored.delivered();
      allVoxels(*openTiffSlices(info, {path}, *slices, stored, {}));
    } catch (const Error& error) {
      EXPECT_CONTAINS(std::string(error.what()), "scan.tif");
      ++damaged;
    }
  }
  EXPECT_GT(whole, 500);
  EXPECT_GT(damaged, 100);
  EXPECT_GT(others, 300);
}

}  // namespace
}  // namespace isobrick::test
