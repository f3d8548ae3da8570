#include "isobrick/viewer/serve/access.h"

#include <sys/random.h>

#include <array>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// The same text without its scheme: what browsers send as Host.
std::string hostOf(const std::string& origin) { return origin.substr(origin.find("://") + 3); }

}  // namespace

std::string newKey() {
  std::array<unsigned char, 16> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    throw Error("the system gives no random numbers for a key");
  std::string key;
  for (const unsigned char byte : bytes)
    for (const int digit : {byte >> 4, byte & 15}) key += "0123456789abcdef"[digit];
  return key;
}

std::string checkedOrigin(const std::string& origin) {
  constexpr char kHostCharacters[] = "abcdefghijklmnopqrstuvwxyz0123456789.-:[]";
  const std::string lower = lowercase(origin);
  const bool has_scheme = lower.starts_with("http://") || lower.starts_with("https://");
  const std::string host = has_scheme ? hostOf(lower) : "";
  if (host.empty() || host.find_first_not_of(kHostCharacters) != std::string::npos)
    throw Error("'" + origin + "' is no origin; give scheme, host and port alone, such as " +
                "https://scans.example.org");
  return lower;
}

Access::Access(std::string key, std::set<std::string> foreign)
    : key_(std::move(key)), foreign_(std::move(foreign)) {
  // The last two are of VS Code, which shows notebooks in frames of its window; no page of the
  // network is within them.
  policy_ =
      "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
      "connect-src 'self'; style-src 'self'; style-src-attr 'unsafe-inline'; "
      "img-src 'self' blob: data:; font-src 'self'; base-uri 'none'; form-action 'none'; "
      "frame-ancestors 'self' vscode-webview: vscode-file:";
  for (const std::string& origin : foreign_) {
    hosts_.insert(hostOf(origin));
    policy_ += " " + origin;
  }
}

void Access::addHost(const std::string& host) { hosts_.insert(lowercase(host)); }

// Takes as long wherever the first difference is.
bool Access::isKey(std::string_view key) const {
  if (key.size() != key_.size()) return false;
  int difference = 0;
  for (std::size_t i = 0; i < key.size(); ++i) difference |= key[i] ^ key_[i];
  return difference == 0;
}

bool Access::isAuthorized(std::string_view authorization) const {
  constexpr std::string_view kScheme = "Bearer ";
  return authorization.starts_with(kScheme) && isKey(authorization.substr(kScheme.size()));
}

bool Access::isOwnHost(std::string_view host, std::string_view local) const {
  const std::string lower = lowercase(std::string(host));
  return lower == local || hosts_.count(lower) != 0;
}

bool Access::isAllowedOrigin(std::string_view origin, std::string_view host) const {
  // A page of an --origin has its name as Host, and is among the foreign ones.
  return origin.empty() || isForeign(origin) || origin == "http://" + lowercase(std::string(host));
}

bool Access::isForeign(std::string_view origin) const {
  return foreign_.count(std::string(origin)) != 0;
}

}  // namespace isobrick
