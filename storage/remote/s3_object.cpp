#include "isobrick/storage/remote/s3_object.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <string_view>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// A file of settings is not longer.
constexpr std::size_t kMostFileBytes = std::size_t{1} << 20;

using Settings = std::map<std::string, std::string>;

// The settings of a section, "[name]"; nothing if there is none. Indented lines belong to the
// setting before them.
std::optional<Settings> sectionOf(const std::string& file, const std::string& section) {
  std::optional<Settings> settings;
  bool is_inside = false;
  std::istringstream lines(file);
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line[0] == '#' || line[0] == ';' || line[0] == ' ' || line[0] == '\t')
      continue;
    if (line[0] == '[') {
      is_inside = trimmed(line.substr(1, line.find(']') - 1)) == section;
      if (is_inside && !settings) settings.emplace();
      continue;
    }
    const std::size_t equals = line.find('=');
    if (!is_inside || equals == std::string::npos) continue;
    const std::string_view text = line;
    (*settings)[lowercase(std::string(trimmed(text.substr(0, equals))))] =
        trimmed(text.substr(equals + 1));
  }
  return settings;
}

// The server of an account, without a slash at its end.
std::string endpointOf(std::string text, const char* variable) {
  while (text.ends_with('/')) text.pop_back();
  const std::string scheme = lowercase(text.substr(0, 8));
  if (!text.empty() && !scheme.starts_with("http://") && !scheme.starts_with("https://"))
    throw Error("the endpoint '" + text + "' is no URL; set " + variable +
                " to one such as https://host:9000");
  return text;
}

// Nothing if both are empty. Both come from `where`; `names` are what to set.
std::optional<S3Keys> pairOf(std::string id, std::string secret, std::string token,
                             const std::string& where,
                             const char* names = "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY") {
  if (id.empty() && secret.empty()) return std::nullopt;
  if (id.empty() || secret.empty())
    throw Error("of the keys for S3, " + where + " have one of two; give both of " + names);
  return S3Keys{std::move(id), std::move(secret), std::move(token)};
}

class AccountFinder {
 public:
  explicit AccountFinder(const S3Surroundings& surroundings) : surroundings_(surroundings) {
    std::string profile = firstOf({"AWS_PROFILE", "AWS_DEFAULT_PROFILE"});
    const bool is_named = !profile.empty();
    if (!is_named) profile = "default";
    const std::string home = surroundings.variable("HOME");
    const auto path = [&](const char* variable, const char* usual) {
      const std::string given = surroundings.variable(variable);
      return given.empty() ? home + usual : given;
    };
    const std::string configuration = surroundings.file(path("AWS_CONFIG_FILE", "/.aws/config"));
    auto settings = sectionOf(configuration, "profile " + profile);
    if (!settings && profile == "default") settings = sectionOf(configuration, profile);
    auto keys = sectionOf(
        surroundings.file(path("AWS_SHARED_CREDENTIALS_FILE", "/.aws/credentials")), profile);
    if (is_named && !settings && !keys)
      throw Error("there is no profile '" + profile +
                  "' in ~/.aws/config or ~/.aws/credentials; set AWS_PROFILE to one that is there");
    profile_ = profile;
    if (settings) settings_ = *std::move(settings);
    if (keys) credentials_ = *std::move(keys);
  }

  S3Account account() const {
    S3Account account;
    if (!isAnonymous()) account.keys = keys();
    account.region = firstOf({"AWS_REGION", "AWS_DEFAULT_REGION"});
    if (account.region.empty()) account.region = setting("region");
    if (account.region.empty()) account.region = "us-east-1";
    account.endpoint = firstOf({"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"});
    if (account.endpoint.empty()) account.endpoint = setting("endpoint_url");
    account.endpoint = endpointOf(account.endpoint, "AWS_ENDPOINT_URL");
    return account;
  }

 private:
  bool isAnonymous() const {
    const std::string word = lowercase(surroundings_.variable("AWS_NO_SIGN_REQUEST"));
    return word == "yes" || word == "true" || word == "1";
  }

  std::optional<S3Keys> keys() const {
    const auto variable = [&](const char* name) { return surroundings_.variable(name); };
    if (auto given = pairOf(variable("AWS_ACCESS_KEY_ID"), variable("AWS_SECRET_ACCESS_KEY"),
                            variable("AWS_SESSION_TOKEN"), "the variables"))
      return given;
    for (const Settings* settings : {&credentials_, &settings_}) {
      const auto value = [&](const char* name) {
        const auto found = settings->find(name);
        return found == settings->end() ? std::string() : found->second;
      };
      if (auto given = pairOf(value("aws_access_key_id"), value("aws_secret_access_key"),
                              value("aws_session_token"), "the profile '" + profile_ + "'"))
        return given;
      for (const char* const way : {"role_arn", "sso_session", "sso_start_url",
                                    "credential_process", "web_identity_token_file"})
        if (settings->contains(way))
          throw Error("the profile '" + profile_ + "' says how to get keys (" + way +
                      "), which isobrick does not do; set the variables that 'aws configure "
                      "export-credentials' prints");
    }
    return std::nullopt;
  }

  std::string setting(const char* name) const {
    const auto found = settings_.find(name);
    return found == settings_.end() ? std::string() : found->second;
  }
  std::string firstOf(std::initializer_list<const char*> names) const {
    for (const char* const name : names)
      if (std::string value = surroundings_.variable(name); !value.empty()) return value;
    return {};
  }

  const S3Surroundings& surroundings_;
  std::string profile_;
  Settings settings_, credentials_;
};

bool isBucketName(const std::string& name) {
  return !name.empty() && name.size() <= 255 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
           c == '.' || c == '_';
  });
}

// A region becomes a part of a host's name.
bool isRegionName(const std::string& name) {
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

// A part of a path that libcurl takes out.
bool hasDotSegment(const std::string& key) {
  const std::string path = "/" + key + "/";
  return path.find("/./") != std::string::npos || path.find("/../") != std::string::npos;
}

// Every byte but letters, digits, - . _ ~ and / as %XX: libcurl signs the path as it stands.
std::string encodedPath(std::string_view path) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::string text;
  for (const char c : path) {
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                          (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_' || c == '~' ||
                          c == '/';
    if (is_plain) {
      text += c;
    } else {
      const auto byte = static_cast<std::uint8_t>(c);
      text += '%';
      text += kDigits[byte >> 4];
      text += kDigits[byte & 15];
    }
  }
  return text;
}

}  // namespace

S3Surroundings systemSurroundings() {
  return {[](const std::string& name) {
            const char* const value = std::getenv(name.c_str());
            return std::string(value != nullptr ? value : "");
          },
          [](const std::string& path) {
            std::ifstream file(path, std::ios::binary);
            std::string text(kMostFileBytes, '\0');
            file.read(text.data(), static_cast<std::streamsize>(text.size()));
            text.resize(static_cast<std::size_t>(file.gcount()));
            return text;
          }};
}

S3Account findS3Account(const S3Surroundings& surroundings) {
  return AccountFinder(surroundings).account();
}

bool isGoogleUrl(const std::string& url) { return lowercase(url.substr(0, 5)) == "gs://"; }

S3Account findGoogleAccount(const S3Surroundings& surroundings) {
  S3Account account;
  account.region = "auto";
  account.keys = pairOf(surroundings.variable("GS_ACCESS_KEY_ID"),
                        surroundings.variable("GS_SECRET_ACCESS_KEY"), "", "the variables",
                        "GS_ACCESS_KEY_ID and GS_SECRET_ACCESS_KEY");
  account.endpoint =
      endpointOf(surroundings.variable("STORAGE_EMULATOR_HOST"), "STORAGE_EMULATOR_HOST");
  if (account.endpoint.empty()) account.endpoint = "https://storage.googleapis.com";
  return account;
}

S3Object::S3Object(const std::string& url, S3Account account) : account_(std::move(account)) {
  const std::string place = url.substr(std::min(url.size(), url.find("://") + 3));
  const std::size_t slash = place.find('/');
  bucket_ = place.substr(0, slash);
  if (slash != std::string::npos) key_ = place.substr(slash + 1);
  if (!isBucketName(bucket_) || key_.empty())
    throw Error("cannot open '" + url + "': it names no object; give " +
                    (isGoogleUrl(url) ? "gs" : "s3") + "://bucket/key",
                {.path = url});
  if (account_.keys && hasDotSegment(key_))
    throw Error("cannot open '" + url + "': requests for a name with '.' or '..' between slashes " +
                    "cannot be signed; copy the object to another name",
                {.path = url});
  if (!isRegionName(account_.region))
    throw Error("cannot open '" + url + "': '" + account_.region +
                    "' is no region; set AWS_REGION to one such as eu-central-1",
                {.path = url});
}

std::string S3Object::url() const {
  const std::lock_guard lock(mutex_);
  const std::string key = "/" + encodedPath(key_);
  if (!account_.endpoint.empty()) return account_.endpoint + "/" + bucket_ + key;
  const std::string server = "s3." + account_.region + ".amazonaws.com" +
                             (account_.region.starts_with("cn-") ? ".cn" : "");
  const bool is_in_name = bucket_.find_first_of("._") == std::string::npos;
  return "https://" + (is_in_name ? bucket_ + "." + server : server + "/" + bucket_) + key;
}

void S3Object::address(HttpRequest& request) const {
  request.url = url();
  request.follows_redirects = false;  // a signature is for one host
  if (!account_.keys) return;
  const std::lock_guard lock(mutex_);
  request.signature = {account_.keys->id, account_.keys->secret, account_.region};
  request.headers.emplace_back("x-amz-content-sha256: UNSIGNED-PAYLOAD");  // there is no body
  if (!account_.keys->token.empty())
    request.headers.push_back("x-amz-security-token: " + account_.keys->token);
}

void S3Object::useRegion(const std::string& region) {
  const std::lock_guard lock(mutex_);
  if (isRegionName(region)) account_.region = region;
}

S3Account S3Object::account() const {
  const std::lock_guard lock(mutex_);
  return account_;
}

}  // namespace isobrick
