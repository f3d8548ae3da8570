// VTK ImageData files (.vti) for tests: all variants that writers of such files use.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tests/support/packed_bytes.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {

struct VtiVariant {
  std::string format = "raw";  // "raw" or "base64" (both appended), or "binary"
  bool zlib = false;
  bool wide = true;  // header_type UInt64
  bool big_endian = false;
  std::size_t block_bytes = 64;
  bool split_header = false;  // base64: the plain header by itself, as some writers do
  // Packs a block in place of zlib; then VtiFrame::compressor names it.
  std::function<std::string(const std::string&)> pack = {};
};

// The numbers before the voxels, and the voxels.
struct VtiEncoded {
  std::string header, data;
};
inline VtiEncoded vtiEncoded(const std::string& bytes, const VtiVariant& v) {
  std::vector<std::uint64_t> words;
  VtiEncoded result;
  if (v.zlib) {
    std::vector<std::uint64_t> sizes;
    for (std::size_t at = 0; at < bytes.size(); at += v.block_bytes) {
      const std::string part = bytes.substr(at, v.block_bytes);
      const std::string block = v.pack ? v.pack(part) : deflated(part, false);
      sizes.push_back(block.size());
      result.data += block;
    }
    words = {sizes.size(), v.block_bytes, bytes.size() % v.block_bytes};
    words.insert(words.end(), sizes.begin(), sizes.end());
  } else {
    words = {bytes.size()};
    result.data = bytes;
  }
  for (const std::uint64_t word : words)
    result.header +=
        v.wide ? bytesOfValues(std::vector<std::uint64_t>{word}, v.big_endian)
               : bytesOfValues(std::vector<std::uint32_t>{static_cast<std::uint32_t>(word)},
                               v.big_endian);
  return result;
}

inline std::string vtiText(const VtiEncoded& encoded, const VtiVariant& v) {
  if (v.format == "raw") return encoded.header + encoded.data;
  if (v.zlib || v.split_header) return base64(encoded.header) + base64(encoded.data);
  return base64(encoded.header + encoded.data);
}

// The text around the arrays; hostile tests replace parts of it.
struct VtiFrame {
  std::string file_type = "ImageData";
  std::string image = R"(WholeExtent="0 6 0 4 0 5" Origin="1 2 3" Spacing="0.5 0.25 2")";
  std::string piece = R"(Extent="0 6 0 4 0 5")";
  std::string point_data = R"(Scalars="values")";
  std::string compressor;
};

inline std::string vtiBytes(const std::string& type, const std::string& text, const VtiVariant& v,
                            const VtiFrame& frame = {}, const std::string& array_attributes = "") {
  const bool appended = v.format != "binary";
  // An array before it, so that the offset is not 0.
  const std::string other = appended ? "12345678" : base64("12345678");
  std::string compressor = frame.compressor;
  if (compressor.empty() && v.zlib) compressor = "vtkZLibDataCompressor";
  std::string xml = "<?xml version=\"1.0\"?>\n<!-- a > comment -->\n<VTKFile type=\"" +
                    frame.file_type + "\" version=\"1.0\" byte_order=\"" +
                    (v.big_endian ? "BigEndian" : "LittleEndian") + "\" header_type=\"" +
                    (v.wide ? "UInt64" : "UInt32") + "\"" +
                    (compressor.empty() ? "" : " compressor=\"" + compressor + "\"") + ">\n";
  xml += "<ImageData " + frame.image + ">\n<FieldData><DataArray type=\"Float64\" Name=\"Time\" " +
         "format=\"ascii\"> 1 </DataArray></FieldData>\n<Piece " + frame.piece + ">\n<PointData " +
         frame.point_data + ">\n";
  const auto array = [&](const std::string& attributes, const std::string& offset,
                         const std::string& content) {
    xml += "<DataArray " + attributes + " format='" + (appended ? "appended" : "binary") + "'";
    if (appended) xml += " offset=\"" + offset + "\"";
    xml += ">\n  " + (appended ? "" : content) + "\n</DataArray>\n";
  };
  array(R"(type="Float32" Name="other &lt;" NumberOfComponents="3")", "0", other);
  array("type=\"" + type + "\" Name=\"values\" RangeMin=\"0\" " + array_attributes, "8", text);
  xml += "</PointData>\n<CellData/>\n</Piece>\n</ImageData>\n";
  if (appended)
    xml +=
        "<AppendedData encoding=\"" + v.format + "\">\n   _" + other + text + "\n</AppendedData>\n";
  return xml + "</VTKFile>\n";
}

}  // namespace isobrick::test
