#include "isobrick/viewer/serve/access.h"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// The same text without its scheme: what browsers send as Host.
std::string hostOf(const std::string& origin) { return origin.substr(origin.find("://") + 3); }

bool isHostCharacter(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
         std::string_view(".-:[]").find(c) != std::string_view::npos;
}

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
  const std::string lower = lowercase(origin);
  const bool has_scheme = lower.rfind("http://", 0) == 0 || lower.rfind("https://", 0) == 0;
  const std::string host = has_scheme ? hostOf(lower) : "";
  if (host.empty() || !std::all_of(host.begin(), host.end(), isHostCharacter))
    throw Error("'" + origin + "' is no origin; give scheme, host and port alone, such as " +
                "https://scans.example.org");
  return lower;
}

Access::Access(std::string key, std::set<std::string> foreign)
    : key_(std::move(key)), foreign_(std::move(foreign)) {
  for (const std::string& origin : foreign_) hosts_.insert(hostOf(origin));
  policy_ =
      "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
      "connect-src 'self'; style-src 'self'; style-src-attr 'unsafe-inline'; "
      "img-src 'self' blob: data:; font-src 'self'; base-uri 'none'; form-action 'none'; "
      "frame-ancestors 'self'";
  for (const std::string& origin : foreign_) policy_ += " " + origin;
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
  return authorization.substr(0, kScheme.size()) == kScheme &&
         isKey(authorization.substr(kScheme.size()));
}

bool Access::isOwnHost(std::string_view host, std::string_view local) const {
  const std::string lower = lowercase(std::string(host));
  return lower == local || hosts_.count(lower) != 0;
}

bool Access::isAllowedOrigin(std::string_view origin, std::string_view host) const {
  if (origin.empty() || isForeign(origin)) return true;
  const std::string own = lowercase(std::string(host));
  // A page of an --origin has its name as Host, and is among the foreign ones.
  return origin == "http://" + own;
}

bool Access::isForeign(std::string_view origin) const {
  return foreign_.count(std::string(origin)) != 0;
}

}  // namespace isobrick
