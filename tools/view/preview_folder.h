// A folder for what a build shows of itself.
#pragma once

#include <string>

namespace isobrick {

// In memory where there is a place for that; for this user alone. It goes, with all in it, with the
// object; that of a process that was killed, when the next one is made.
class PreviewFolder {
 public:
  PreviewFolder();
  ~PreviewFolder();
  PreviewFolder(const PreviewFolder&) = delete;
  PreviewFolder& operator=(const PreviewFolder&) = delete;

  const std::string& path() const { return path_; }  // empty: it could not be made

 private:
  std::string path_;
};

}  // namespace isobrick
