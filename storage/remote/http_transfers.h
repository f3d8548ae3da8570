// Requests for ranges over HTTP, many at once, on one thread.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace isobrick {

// What signs a request to S3: version 4 of Amazon's signatures.
struct S3Signature {
  std::string id, secret, region;
};

// A GET of the bytes first .. last, both included, or of the last ones of a file.
struct HttpRequest {
  std::uint64_t id = 0;  // the client's
  std::string url;       // http:// or https://
  std::uint64_t first = 0, last = 0;
  std::uint64_t end_bytes = 0;       // above 0: the last so many bytes instead
  std::vector<std::string> headers;  // more of them, a whole line each
  std::optional<S3Signature> signature;
  bool follows_redirects = true;  // at most HttpTransfers::kMostRedirects, and never to http://
                                  // from https://
};

// The last answer to a request, before its body. Texts are as the server sent them, "" if it did
// not.
struct HttpHead {
  int status = 0;
  std::string content_range, content_encoding, etag, last_modified, retry_after, bucket_region;
  std::optional<std::uint64_t> content_length;
};

// How a request ended.
struct HttpEnd {
  bool is_whole = false;      // the answer came to its end
  bool was_refused = false;   // the client ended it in onHead() or onBytes()
  bool may_pass = false;      // the same request may succeed later
  bool is_unreached = false;  // no connection came to be
  std::string text;           // of what went wrong, and behind a semicolon what to do
  std::string url;            // that answered, after redirects
};

// Gives HttpTransfers its requests, and takes the answers: one for each file. All members are
// called by the thread of HttpTransfers.
class HttpClient {
 public:
  virtual ~HttpClient() = default;
  // The request to begin now. If there is none: nothing, and `*wait` may be made shorter if one is
  // due before the next call of HttpTransfers::wake().
  virtual std::optional<HttpRequest> nextRequest(std::chrono::milliseconds* wait) = 0;
  // False ends the request.
  virtual bool onHead(std::uint64_t id, const HttpHead& head) = 0;
  // The next bytes of the body; false ends the request.
  virtual bool onBytes(std::uint64_t id, std::span<const std::byte> bytes) = 0;
  virtual void onEnd(std::uint64_t id, const HttpEnd& end) = 0;
};

// Sends the requests of its clients over as few connections as serve: as streams of a single one if
// the server speaks HTTP/2, else over kMostConnections. Proxies are those of the usual variables
// (https_proxy, no_proxy, ...), passwords those of ~/.netrc. Certificates are checked against the
// system's, or against the file that CURL_CA_BUNDLE, AWS_CA_BUNDLE or SSL_CERT_FILE names.
class HttpTransfers {
 public:
  static constexpr int kMostRequests = 32;
  static constexpr int kMostConnections = 32;
  static constexpr int kMostRedirects = 5;
  // A server that takes longer to answer than its connection to come to be, hangs.
  static constexpr double kConnectSeconds = 10;
  // However slowly it goes on, a request has ended then.
  static constexpr double kMostSeconds = 600;

  // Throws Error if there is no thread, or no memory.
  explicit HttpTransfers(double stall_seconds);
  // No client is left.
  ~HttpTransfers();
  HttpTransfers(const HttpTransfers&) = delete;
  HttpTransfers& operator=(const HttpTransfers&) = delete;

  // From now on the client is asked for requests, in turn with the others. By any thread, as all
  // below.
  void enter(HttpClient& client);
  // Ends the requests of the client at once; when this returns, nothing of it is called any more.
  void leave(HttpClient& client);
  // Has the clients asked for their next requests.
  void wake();

 private:
  class Loop;
  std::unique_ptr<Loop> loop_;
};

}  // namespace isobrick
