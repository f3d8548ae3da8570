#include "isobrick/preprocess/sources/raw_run.h"

#include <map>
#include <sstream>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/header_text.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// "LIST" and "slice%03d.raw 1 9 1" are several files. No name at all is one that cannot be opened:
// ITK would request all memory.
bool isOneFile(const std::string& name) {
  return !name.starts_with("LIST") && name.find('%') == std::string::npos;
}

// True if the values of a voxel are the first of four axes: "sizes: 3 64 64 64".
bool hasValuesTogether(std::map<std::string, std::string>& fields, std::uint64_t components,
                       const Index3& voxels) {
  std::istringstream sizes(fields["sizes"]), kinds(fields["kinds"]);
  std::uint64_t first = 0;
  Index3 others(0);
  std::string kind;
  kinds >> kind;
  return fields["dimension"] == "4" && sizes >> first >> others.x >> others.y >> others.z &&
         first == components && others == voxels && !kind.empty() && kind != "domain" &&
         kind != "space" && kind != "time";
}

}  // namespace

std::vector<std::string> headerAndData(const std::string& header_path,
                                       const std::string& data_path) {
  if (header_path.empty() || header_path == data_path) return {data_path};
  return {header_path, data_path};
}

std::optional<RawRun> findNrrdRun(const std::string& header_path, std::uint64_t components,
                                  const Index3& voxels) {
  const auto header = readNrrdHeader(header_path);
  if (!header) return std::nullopt;
  std::map<std::string, std::string> fields = header->fields;
  const std::string encoding = lowercase(fields["encoding"]);
  RawRun run;
  run.header_path = header_path;
  run.is_deflated = encoding == "gzip" || encoding == "gz";
  if ((encoding != "raw" && !run.is_deflated) || fields.contains("lineskip") ||
      !(components == 1 ? fields["dimension"] == "3"
                        : hasValuesTogether(fields, components, voxels)))
    return std::nullopt;
  run.big_endian = lowercase(fields["endian"]) == "big";
  if (fields.contains("byteskip")) {
    const auto skip = numberIn<std::uint64_t>(fields["byteskip"]);
    if (!skip) return std::nullopt;  // -1: counted from the end
    // The format skips bytes after it has inflated them.
    (run.is_deflated ? run.content_offset_bytes : run.offset_bytes) = *skip;
  }
  if (fields.contains("datafile")) {
    const std::string& name = fields["datafile"];
    if (!isOneFile(name)) return std::nullopt;
    run.path = besideHeader(header_path, name);
  } else {
    if (!header->end || run.offset_bytes + run.content_offset_bytes != 0) return std::nullopt;
    run.path = header_path;
    run.offset_bytes = *header->end;
  }
  return run;
}

std::optional<RawRun> findMetaImageRun(const std::string& header_path) {
  const auto header = readMetaImageHeader(header_path);
  if (!header) return std::nullopt;
  std::map<std::string, std::string> fields = header->fields;
  const auto isTrue = [&](const std::string& name) {
    const std::string& value = fields[name];
    return !value.empty() && (value[0] == 'T' || value[0] == 't' || value[0] == '1');
  };
  if (!isTrue("binarydata") || fields["ndims"] != "3") return std::nullopt;
  RawRun run;
  run.header_path = header_path;
  run.is_deflated = isTrue("compresseddata");
  run.big_endian = isTrue("elementbyteordermsb") || isTrue("binarydatabyteordermsb");
  // Two fields that say the same, or that contradict each other.
  if (fields["elementbyteordermsb"] != fields["binarydatabyteordermsb"] &&
      !fields["elementbyteordermsb"].empty() && !fields["binarydatabyteordermsb"].empty())
    return std::nullopt;
  if (fields.contains("headersize")) {
    const auto skip = numberIn<std::uint64_t>(fields["headersize"]);
    if (!skip) return std::nullopt;  // -1: counted from the end
    run.offset_bytes = *skip;
  }
  const std::string& name = fields["elementdatafile"];
  if (lowercase(name) == "local") {
    if (!header->end || run.offset_bytes != 0) return std::nullopt;
    run.path = header_path;
    run.offset_bytes = *header->end;
  } else {
    if (!isOneFile(name)) return std::nullopt;
    run.path = besideHeader(header_path, name);
  }
  return run;
}

}  // namespace isobrick
