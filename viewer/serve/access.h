// Who may ask what: keys, hosts and origins of requests, compared byte by byte.
#pragma once

#include <set>
#include <string>
#include <string_view>

namespace isobrick {

// 128 random bits as 32 hexadecimal digits. Throws Error if the system gives none.
std::string newKey();

// "https://scans.example.org:8443" in small letters, without a path. Throws Error for other text.
std::string checkedOrigin(const std::string& origin);

// Does not change while requests come; any thread may ask it.
class Access {
 public:
  // `foreign`: other origins that may use the server, each by checkedOrigin().
  Access(std::string key, std::set<std::string> foreign);

  // A name by which the server itself is asked: "127.0.0.1:8080".
  void addHost(const std::string& host);

  const std::string& key() const { return key_; }
  bool isKey(std::string_view key) const;
  // Of the header Authorization: "Bearer KEY".
  bool isAuthorized(std::string_view authorization) const;
  // Of the header Host; `local` is the address and port that the request came to.
  bool isOwnHost(std::string_view host, std::string_view local) const;
  // Of the header Origin, beside a host that is the server's own. Empty: there is no such header.
  bool isAllowedOrigin(std::string_view origin, std::string_view host) const;
  bool isForeign(std::string_view origin) const;
  // The page, and which other ones may show it in a frame.
  const std::string& contentPolicy() const { return policy_; }

 private:
  const std::string key_;
  const std::set<std::string> foreign_;
  std::set<std::string, std::less<>> hosts_;
  std::string policy_;
};

}  // namespace isobrick
