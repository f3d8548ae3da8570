#include "isobrick/storage/remote_options.h"

#include <algorithm>

#include "isobrick/storage/lowercase.h"

namespace isobrick {

bool isRemotePath(std::string_view path) {
  const std::string begin = lowercase(std::string(path.substr(0, 8)));
  return begin.starts_with("http://") || begin.starts_with("https://") || isBucketPath(path);
}

bool isBucketPath(std::string_view path) {
  const std::string begin = lowercase(std::string(path.substr(0, 5)));
  return begin == "s3://" || begin == "gs://";
}

std::string withoutSecrets(const std::string& url) {
  std::string shown = url;
  const std::size_t scheme = shown.find("://");
  if (scheme == std::string::npos || isBucketPath(url)) return shown;
  shown.resize(std::min(shown.find_first_of("?#"), shown.size()));
  const std::size_t host = scheme + 3;
  const std::size_t host_end = std::min(shown.find('/', host), shown.size());
  const std::size_t at = shown.substr(0, host_end).rfind('@');
  if (at != std::string::npos && at >= host) shown.erase(host, at + 1 - host);
  return shown;
}

}  // namespace isobrick
